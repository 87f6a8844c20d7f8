"""Figure 4.6: target error against iterations, KF-ADMM with 19 and with 10 markers."""

from pathlib import Path

import numpy as np

from arm_brachy.core.paths import share_dir
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.experiments import figure_4_5, inside_iterations, inside_study
from arm_brachy.experiments.inside_iterations import EXPERIMENTS

NAME = 'figure-4.6'


def reproduce(out_dir, traces=None):
    """Iterate from rest with both sets of markers; figure-4.6.png shows four experiments.

    out_dir : folder;  traces : of `inside_iterations.run`, computed if not given
    Returns Result, a row for each experiment and method.
    """
    traces = traces or inside_iterations.run(out_dir, (19, 10))
    figure_4_5.draw(traces).savefig(Path(out_dir) / f'{NAME}.png', dpi=150)
    return Result(NAME, inside_study.SEED, commit_of(share_dir()), machine_description(),
                  inside_iterations.rows(traces), targets(traces))


def targets(traces):
    """The thesis' claim: fewer markers are worse, and still better than none."""
    many, few, none = (np.mean([traces[m].mean(e)[-1] for e in EXPERIMENTS])
                       for m in ('kf_admm_19', 'kf_admm_10', 'admm'))
    return (Target('error in the end with 10 markers over that with 19', few / many, '1', '> 1',
                   bool(few > many)),
            Target('error in the end with 10 markers over that of ADMM', few / none, '1', '< 1',
                   bool(few < none)))
