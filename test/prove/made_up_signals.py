"""A made-up oracle: every effect has a direction of its own, as long as its size times ten."""

import numpy as np

NAMES = ('backlash', 'force_gain', 'strange_thing')


class Sight:
    def __init__(self, jobs, cache):
        assert len({job.body for job in jobs}) == 1

    def label(self, job):
        return job.wish or 'strange_thing'

    def is_rival(self, job):
        return True

    def effect(self, job, other):
        return 10.0 * other.rng().uniform(0.2, 2.0) * np.eye(5)[NAMES.index(self.label(other))]

    def twins(self, job):
        return [('twin', self.effect(job, job) + 99.0 * np.eye(5)[4])]

    def nuisances(self, job, mode):
        return np.zeros((5, 1))

    def tolerances(self, job, mode):
        return np.ones((5, 1))
