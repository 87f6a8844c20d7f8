"""What is left over time, stream by stream, as it is drawn.

Test: diagnosis/test_diagnose.py
"""

import numpy as np

from arm_brachy.diagnosis.report import conclusions
from arm_brachy.diagnosis.report.figures import Trace
from arm_brachy.diagnosis.selection.problem import left_over


def traces(assembly, found):
    """figures.Trace of every stream of every recording, what the mesh is wrong by left in.

    found : judge.Explanation each, of what was found
    """
    before, out = left_over(assembly, (), mesh=True), []
    named = left_over(assembly, found, mesh=True) if found else None
    rows = np.arange(len(before))
    for m, mine in conclusions.split_rows(assembly, rows):
        kinds = np.array([row.kind for row in m.observables.rows])
        lines = [m.observables.coloured(values[mine]) for values in (before, named)
                 if values is not None]
        for kind in dict.fromkeys(kinds.tolist()):
            here, n = kinds == kind, len(m.recorded.states.t)
            states = m.observables.states[here]
            drawn = [_over_states(states, line[here], n) for line in lines]
            floor = float(np.sqrt(np.mean(m.observables.sd[here]**2)))
            out.append(Trace(m.recorded.name, kind, m.recorded.states.t, drawn[0], floor,
                             drawn[1] if named is not None else None))
    return tuple(out)


def _over_states(states, values, n):
    """(n,) root mean square of values at every state; NaN where there is none."""
    count = np.bincount(states, minlength=n).astype(float)
    count[count == 0.0] = np.nan
    return np.sqrt(np.bincount(states, values**2, minlength=n) / count)
