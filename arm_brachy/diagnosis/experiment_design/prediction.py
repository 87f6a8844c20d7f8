"""A recording that could be made, over its noise: what each explanation would do in it.

Test: diagnosis/test_next_experiment.py
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from arm_brachy.devices.em_tracker import EmTrackerParams
from arm_brachy.devices.force_sensor import ForceSensorParams
from arm_brachy.devices.optical_tracker import OpticalParams
from arm_brachy.diagnosis.experiment_design.advice import passes
from arm_brachy.diagnosis.likelihood.discrepancy import with_accuracy
from arm_brachy.diagnosis.likelihood.match import OWN
from arm_brachy.diagnosis.likelihood.nuisances import nuisances
from arm_brachy.diagnosis.likelihood.observation import Measured, Observables, channels_of
from arm_brachy.diagnosis.likelihood.tolerances import joined, tolerances
from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.signals.noise import Noise, data_sheet_sd
from arm_brachy.diagnosis.signals.stream import EM, FORCE, OPTICAL
from arm_brachy.diagnosis.statistics.noise_process import Colour

SHEETS = {OPTICAL: OpticalParams, EM: EmTrackerParams, FORCE: ForceSensorParams}


@dataclass(frozen=True)
class Option:
    """One explanation of a class, as it was fitted.

    name : a term, or 'a + b';  hypotheses : hypothesis.Hypothesis each
    amplitudes : (p,) of all their strengths, in typical sizes
    """

    name: str
    hypotheses: tuple
    amplitudes: np.ndarray

    @property
    def lasts(self):
        """(p,) False for strengths of what happens once, and not in the next recording."""
        return np.array([not passes(one.name) for one in self.hypotheses for _ in one.strengths])

    @property
    def size(self):
        """(p,) the amplitudes in prior standard deviations."""
        spread = [s.spread for one in self.hypotheses for s in one.strengths]
        return np.asarray(self.amplitudes, dtype=float) / np.array(spread)


@dataclass(frozen=True)
class Whitened:
    """A recording, made or to be made, over its noise.

    U : (N, k) nuisances, each times its standard deviation;  names : k, as in Nuisances
    columns : (N, p) of each option, per prior standard deviation
    """

    U: np.ndarray
    names: tuple
    columns: tuple

    def normal(self):
        """(names of nuisances that other recordings share, products of these and of all columns).

        What is this recording's own (`match.OWN`) is integrated out.
        """
        own = np.array([name.startswith(OWN) for name in self.names], dtype=bool)
        rest = np.hstack([self.U[:, ~own], *self.columns])
        shared = tuple(n for n, o in zip(self.names, own, strict=True) if not o)
        V = self.U[:, own]
        return shared, integrated(V.T @ V, V.T @ rest, rest.T @ rest)


def calibrated(baseline):
    """Nuisances of a Baseline that any recording has, errors of the mesh left out."""
    return joined(nuisances(baseline, several=True), tolerances(baseline))


@dataclass(frozen=True)
class Planned:
    """A trial as all streams of the body would see it.

    kinds : streams;  observables : Observables of these;  whitened : Whitened of all rows
    """

    kinds: tuple
    observables: Observables
    whitened: Whitened

    @property
    def found(self):
        """False where the model finds no state with one of the options."""
        return all(np.isfinite(part).all() for part in self.whitened.columns)

    def lasting(self, options):
        """The same as the next recording: what happens once has no effect."""
        columns = tuple(part * option.lasts for part, option in
                        zip(self.whitened.columns, options, strict=True))
        return replace(self, whitened=replace(self.whitened, columns=columns))

    def take(self, streams):
        """The Whitened of some streams."""
        rows = np.isin([row.kind for row in self.observables.rows], streams)
        every = self.whitened
        return Whitened(every.U[rows], every.names, tuple(part[rows] for part in every.columns))


def planned(trial, baseline, options, noise, nuisance_columns=calibrated):
    """The Planned of a trials.Trial and its Baseline; the rest as for a next experiment."""
    channels = channels_of(baseline.model.specimen)
    kinds = tuple(kind for kind, names in channels.items() if names)
    pushes = baseline.model.specimen.directions
    streams = [_measured(kind, channels[kind], trial, noise.get(kind) or _sheet(kind), pushes)
               for kind in kinds]
    rest = {kind: shown[0] for kind, shown in baseline.shown.items()}
    observables = Observables(with_accuracy(streams, baseline.shown, rest, channels), channels)
    around = nuisance_columns(baseline)
    return Planned(kinds, observables, Whitened(
        observables.whiten(around.values), around.names,
        tuple(_columns(baseline, option, observables) for option in options)))


def _measured(kind, names, trial, noise, pushes):
    """observables.Measured of a stream that sees every channel at all states of a Trial.

    pushes : (p, 3) directions of the pads, which load cells of one axis lie along
    """
    n, c, d = len(trial.t), len(names), noise.sd.shape[1]
    count = np.maximum(trial.width / noise.period, 1.0)
    pooled = noise.mean_variance(count[:, None]).mean(axis=1, keepdims=True)
    sd = np.broadcast_to(np.sqrt(pooled), (n, c, d))
    return Measured(kind, names, np.zeros((n, c, d)), np.ones((n, c), bool), sd,
                    noise.between(trial.t, count), along=pushes if d == 1 else None)


def _sheet(kind):
    """Noise by the data sheet of a device that did not record."""
    return Noise(np.full((1, 3), data_sheet_sd(kind)), Colour(), 1.0 / SHEETS[kind]().rate,
                 np.eye(3), 'data sheet')


def _columns(baseline, option, observables):
    """(N, p) whitened answers to an Option."""
    return np.hstack([observables.whiten(respond(baseline, one).per_prior())
                      for one in option.hypotheses])


def integrated(own, cross, rest):
    """rest - cross' (I + own)^-1 cross: products with normal coefficients integrated out."""
    factor = cholesky(np.eye(len(own)) + own, lower=True)
    seen = solve_triangular(factor, cross, lower=True)
    return rest - seen.T @ seen
