"""What could be known from a case at best: Fisher's analysis on noise-free signals.

e is the whitened effect, clean(with) - clean(without); B what nobody calibrates away, a column per
nuisance times its prior standard deviation: those that the generator draws, and what
`finding.Calibration` lets a careful laboratory leave (`signals.Sight.tolerances`).
With M = (1 + B B^T)^-1, by Woodbury,

    detectability^2 = e^T M e,    separation^2 = e^T M e - (e^T M r)^2 / (r^T M r)

from a rival effect r of free size: the Gauss-Markov theorem for Gaussian noise and priors.
Test: prove/test_oracle.py
"""

from importlib import import_module

import numpy as np

from arm_brachy.prove.folder import read_json, write_json
from arm_brachy.prove.plan import CONFOUNDED, NULL

VISIBLE = 1.0       # sd: a rival that is seen less is none


def whitened(values, dt, sd, colour, memory, rate):
    """Signals (t, k), sampled every dt [s], over the noise of a sensor that samples at `rate`.

    sd : of the noise, of whose variance the share `colour` is AR(1) with a time constant `memory`
    [s] and the rest white. Whitened by the noise's spectral density, so that a Fisher analysis of
    dt > 1 / rate loses only what is faster than dt.
    """
    f = np.fft.rfftfreq(len(values), dt)
    density = sd**2 * ((1.0 - colour) / rate + 2.0 * colour * memory / (
        1.0 + (2.0 * np.pi * f * memory)**2))
    shape = np.sqrt(density / dt)[:, None]
    return np.fft.irfft(np.fft.rfft(values, axis=0) / shape, len(values), axis=0)


def seen(effect, nuisances, rivals):
    """Detectability [sd], separation [sd] and name of the nearest rival; the latter None.

    effect (n,); nuisances (n, k), both whitened, nuisances times prior sd; rivals: (name, (n,))
    """
    inner = np.linalg.cholesky(np.eye(nuisances.shape[1]) + nuisances.T @ nuisances)

    def dot(a, b):
        left, right = (np.linalg.solve(inner, nuisances.T @ v) for v in (a, b))
        return float(a @ b - left @ right)

    own = dot(effect, effect)
    apart, nearest = None, ''
    for name, rival in rivals:
        size = dot(rival, rival)
        if size >= VISIBLE**2:
            left = np.sqrt(max(own - dot(effect, rival)**2 / size, 0.0))
            if apart is None or left < apart:
                apart, nearest = left, name
    return {'detectability_sd': float(np.sqrt(max(own, 0.0))),
            'separation_sd': None if apart is None else float(apart), 'rival': nearest}


def analyse_all(folder, jobs, modes, source, workers, progress):
    """Columns of `seen` for every case that has something to see: case -> mode -> dict; kept.

    folder : TrialFolder;  source : name of a module as `prove.signals`;  workers : Workers
    progress(stage, done, of) counts bodies, after each of which the file is written
    """
    found = read_json(folder / 'oracle.json') or {}
    bodies = {}
    for job in jobs:
        if job.kind not in (NULL, CONFOUNDED):
            bodies.setdefault(job.body, []).append(job)
    lacking = [some for some in bodies.values() if not all(job.name in found for job in some)]
    held = len(bodies) - len(lacking)
    progress('oracle', held, len(bodies))
    tasks = [(source, some, modes, folder / 'cache') for some in lacking]
    for done, one in enumerate(workers.each(analyse, tasks), start=held + 1):
        found.update(one)
        write_json(folder / 'oracle.json', found)
        progress('oracle', done, len(bodies))
    return found


def analyse(source, jobs, modes, cache):
    """Columns of `seen` for jobs that share a body: case -> mode -> dict.

    Rivals are the others', of another label and one effect, in the set-up and protocol of the
    case, and what is most like its own where it is (`Sight.twins`).
    """
    sight = import_module(source).Sight(jobs, cache)
    found = {}
    for job in jobs:
        effect = sight.effect(job, job)
        rivals = [(sight.label(other), sight.effect(job, other)) for other in jobs
                  if sight.is_rival(other) and sight.label(other) not in sight.label(job)]
        rivals += sight.twins(job)
        found[job.name] = {mode: _both(effect, sight.nuisances(job, mode),
                                       sight.tolerances(job, mode), rivals) for mode in modes}
    return found


def _both(effect, nuisances, tolerances, rivals):
    """`seen` beside nuisances and tolerances, and `at_best_...` beside the nuisances alone."""
    best = seen(effect, nuisances, rivals)
    return seen(effect, np.hstack([nuisances, tolerances]), rivals) | {
        f'at_best_{key}': best[key] for key in ('detectability_sd', 'separation_sd')}
