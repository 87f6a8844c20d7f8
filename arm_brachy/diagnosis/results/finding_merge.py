"""One finding instead of many alike: what every pad has is said once."""

from dataclasses import replace

import numpy as np

from arm_brachy.diagnosis.results.finding import threshold

CHOSEN = ('actuators', 'pads')   # parameters that name pads; empty means all
ALIKE = 0.1                      # of their mean by which values may differ


def merge(found, pads, moved):
    """Findings with those of one term and parameter merged if all pads have them alike.

    found : Finding each;  pads : names of all;  moved : names of those that a marker was seen to
        move; of an actuator that did not move nothing is known, it is taken to be as the others
    """
    groups = {}
    for finding in found:
        groups.setdefault((finding.stream, finding.term, finding.parameter), []).append(finding)
    out = []
    for (_, term, _), group in groups.items():
        chosen = [name for name in CHOSEN if name in group[0].parameters]
        whole = set(moved) if 'actuators' in chosen else set(pads)
        alone = term is None or not chosen or len(group) < 2
        if alone or {f.channel for f in group} != whole or not _alike(group):
            out += group
        else:
            out.append(_merged(group, chosen[0]))
    return out


def _alike(group):
    """True if the Findings have one value, and one of whatever was estimated with it."""
    beside = [set(f.errors) for f in group]
    return (all(names == beside[0] for names in beside)
            and _agree([f.value for f in group], [f.sd for f in group])
            and all(_agree([f.parameters[name] for f in group], [f.errors[name] for f in group])
                    for name in beside[0]))


def _agree(values, errors):
    values = np.array([np.atleast_1d(v) for v in values])
    errors = np.array([np.broadcast_to(e, np.shape(v)) for e, v in
                       zip(errors, values, strict=True)])
    mean = values.mean(axis=0)
    off = np.abs(values - mean)
    slack = ALIKE * np.linalg.norm(mean) + threshold(len(values)) * errors
    return bool(np.all(off <= slack))


def _merged(group, chosen):
    """The strongest of a group, with the mean value, for all pads."""
    lead = max(group, key=lambda f: f.z)
    value = np.mean([f.value for f in group], axis=0)
    plain = float(value) if np.ndim(value) == 0 else value
    sd = np.linalg.norm([f.sd for f in group], axis=0) / len(group)
    kept = float(value) if np.ndim(value) == 0 else tuple(float(v) for v in value)
    rivals = tuple(dict.fromkeys(r for f in group for r in f.rivals))
    return replace(lead, channel='', value=plain, sd=float(sd) if np.ndim(sd) == 0 else sd,
                   rivals=rivals, statement=f'{lead.statement} All pads have it alike.',
                   parameters={**lead.parameters, lead.parameter: kept, chosen: ()})
