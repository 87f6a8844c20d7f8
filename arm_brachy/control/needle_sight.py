"""Why a needle must not go on under an ultrasound probe: what is lost, not told or not seen.

Each function returns (Outcome, what is wrong and what to do), None if nothing is.
"""

import math

from arm_brachy.core.outcome import Outcome

MM = 1e3


def probe_fault(probe, lost):
    """Fault of the probe over the tip.

    probe : control.procedure.ProbeSeen
    lost : [m] from which on a tip ahead of the image plane is lost
    """
    again = 'scan again or insert more slowly'
    if not probe.in_contact:
        return Outcome.STALE_INPUT, ('probe/state: the probe has lost the skin; must be in '
                                     f'contact while the needle goes in: {again}')
    if not math.isfinite(probe.out_of_plane):
        return Outcome.STALE_INPUT, (
            f'probe/state: the tip is {probe.out_of_plane} m from the image plane; must be a '
            'number: look at needle/tip')
    if probe.out_of_plane > lost:
        return Outcome.STALE_INPUT, (
            f'probe/state: the tip is {MM * probe.out_of_plane:.1f} mm ahead of the image plane; '
            f'must be at most {MM * lost:g} mm: {again}')
    if not probe.outcome.ok:
        return probe.outcome, probe.message or probe.outcome.advice
    return None


def tip_fault(age, patience):
    """Fault of a tip that was found in an image `age` [s] ago, inf = never."""
    if age <= patience:
        return None
    when = f'was last found in an image {age:.1f} s ago' if math.isfinite(age) else (
        'was never found in an image')
    return Outcome.TIP_NOT_SEEN, (f'the tip {when}; must be within {patience:g} s: check contact, '
                                  'hole and depth of the needle')


def target_fault(known, estimate, image, fresh):
    """Fault of a target that neither fresh images nor fresh estimates show.

    known : True if either shows it;  fresh : [s] for which they count
    estimate, image : [s] since the last of each, inf = never
    """
    if known:
        return None
    return Outcome.STALE_INPUT, (
        'neither an estimate nor the images say where the target is: '
        f'{_last("estimate", estimate)}, {_last("image of it (ultrasound/target)", image)}; must '
        f'be at most {fresh:g} s old, and images must agree with each other: look at the markers')


def _last(what, age):
    return f'the last {what} is {age:.1f} s old' if math.isfinite(age) else f'no {what} came'
