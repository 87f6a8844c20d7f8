"""Registration of the optical tracker over time: made at the start, watched, made again."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.core.outcome import Outcome
from arm_brachy.core.quantity import quantity
from arm_brachy.estimation.registration import FEWEST, RegistrationFailed, register_soundly


@dataclass(frozen=True)
class RegistrationParams:
    """Landmarks of the registration: how well their places are known, when it is lost."""

    window: float = quantity(
        0.2, 's', 'length of the stretch whose mean is registered', low=0.0, high=60.0,
        source='20 frames: what is left is the constant error of each marker')
    patience: float = quantity(
        1.0, 's', 'after which a missing registration is reported', low=0.0, high=600.0,
        source='own choice: five windows')
    placement: float = quantity(
        0.1, 'mm', 'sd per axis of the place of a marker on the base', low=1e-3, high=50.0,
        source='holes drilled in a plate, own choice')
    pad_placement: float = quantity(
        0.3, 'mm', 'sd per axis of the place of a marker on a pad, by its encoder', low=1e-3,
        high=50.0, source='play of the lead screw in scenario target_1')
    tissue_placement: float = quantity(
        1.0, 'mm', 'sd per axis of the place of a marker on tissue, used only where base and pads '
        'leave the registration open', low=1e-3, high=50.0,
        source='markers glued by hand, own choice')
    odd: float = quantity(
        8.0, '', 'sd by which a landmark may be off before it is left out, and most of them '
        'before the tracker has moved', low=3.0, high=1000.0,
        source='1 mm for a marker on the base, beyond any noise')
    largest_residual: float = quantity(
        2.0, 'mm', 'rms distance of landmarks from their places beyond which they are not those '
        'of the scene, or the tracker has moved', low=0.05, high=100.0,
        source='own choice: above placement by hand, below any wrong scene')


class Calibration:
    """Registers a tracker over a window of frames and watches whether the landmarks stay.

    registration : the Registration in force, None while there is none
    """

    def __init__(self, params, motion, noise, offset):
        """Start without a registration.

        params : RegistrationParams;  motion : marker_motion.MarkerMotion
        noise, offset : [m] sd per axis of one sample, of the constant error of a marker
        """
        self.params, self._names, self._noise = params, np.array(motion.names), noise
        hard = motion.on_base | motion.on_pad
        sd = np.select([motion.on_base, motion.on_pad], [params.placement, params.pad_placement],
                       params.tissue_placement)
        self._sd = np.hypot(sd, offset)
        self._used = hard if _spans(motion.rest[hard]) else np.ones(len(hard), dtype=bool)
        self.reset()

    def reset(self):
        """Forget the registration."""
        self.registration, self._complaint = None, (Outcome.OK, '')
        self._asked = None
        self._collect()

    def _collect(self):
        m = len(self._names)
        self._begun, self._count = None, np.zeros(m)
        self._sum_M, self._sum_W = np.zeros((m, 3)), np.zeros((m, 3))

    def take(self, t, p_M, p_W):
        """Use one frame.

        t : [s];  p_M : (m, 3) [m] markers by their labels, NaN where hidden
        p_W : (m, 3) [m] where the scene has them at the pads' travel
        Returns (Outcome, message): OK also during the first `patience` without a registration.
        """
        seen = self._used & np.isfinite(p_M).all(axis=1)
        self._asked = t if self._asked is None else self._asked
        if self.registration is not None and not self._astray(seen, p_M, p_W):
            self._collect()
            self._asked = t
            return Outcome.OK, ''
        self._gather(t, seen, p_M, p_W)
        if t - self._begun >= self.params.window:
            self._register()
        if self.registration is not None and not self._astray(seen, p_M, p_W):
            return Outcome.OK, ''
        late = t - self._asked > self.params.patience
        if self._complaint[0].ok and (late or self.registration is not None):
            return Outcome.LOST_REGISTRATION, self._lost(seen)
        return self._complaint

    def _astray(self, seen, p_M, p_W):
        """True if most landmarks are not where the registration puts them; one may be."""
        if seen.sum() < FEWEST:
            return False
        off = np.linalg.norm(self.registration.apply(p_M[seen]) - p_W[seen], axis=1)
        odd = self.params.odd * np.median(np.hypot(self._sd[seen], self._noise))
        return bool(np.median(off) > min(odd, self.params.largest_residual))

    def _gather(self, t, seen, p_M, p_W):
        self._begun = t if self._begun is None else self._begun
        self._count += seen
        self._sum_M[seen] += p_M[seen]
        self._sum_W[seen] += p_W[seen]

    def _register(self):
        """Fit to the means of the window; what cannot be fitted is said and tried again."""
        known = self._count > 0
        count = self._count[known, None]
        sd = np.hypot(self._sd[known], self._noise / np.sqrt(self._count[known]))
        means = self._sum_M[known] / count, self._sum_W[known] / count
        self._collect()
        self.registration = None
        try:
            fit = register_soundly(self._names[known], *means, sd, self.params.odd)
        except RegistrationFailed as error:
            self._complaint = Outcome.LOST_REGISTRATION, str(error)
            return
        if fit.rms > self.params.largest_residual:
            self._complaint = Outcome.WRONG_SCENE, (
                f'landmarks ({", ".join(fit.names)}) do not fit the scene: {fit.rms * 1e3:.0f} mm '
                f'rms, allowed {self.params.largest_residual * 1e3:g} mm')
            return
        self.registration, self._complaint = fit, (Outcome.OK, '')

    def _lost(self, seen):
        names = ', '.join(self._names[seen]) or 'none'
        if self.registration is not None:
            return f'landmarks ({names}) are not where they were: the tracker has moved'
        return f'landmarks seen: {names}; needed are {FEWEST}'


def _spans(points):
    """True if points (k, 3) fix a rotation."""
    if len(points) < FEWEST:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > 0.1 * spread[0])
