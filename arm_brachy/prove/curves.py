"""Curves of a trial: how faint an effect may be, and how far its confidence can be trusted.

Test: prove/test_report.py
"""

import numpy as np

from arm_brachy.evaluation.style import GOAL, OURS, TRUTH, Plate, new_figure, styled
from arm_brachy.prove.totals import BINS, power, risk_coverage

APART = 1.03    # factor between the bars of two curves at one size
CURVES = (('noticed', TRUTH, 'o'), ('named', OURS, 's'))


@styled
def curves_plate(rows, mode):
    """Power over the size of an effect and risk over coverage, as a style.Plate.

    rows : of the answers in one mode, as `score.score` makes them
    """
    figure = new_figure(8.4, 3.0)
    left, right = figure.subplots(1, 2)
    _power(left, power(rows))
    _risk(right, risk_coverage(rows))
    left.set_title(f'Blind trial, mode {mode}')
    return Plate(f'curves-{mode}', figure, 'Left: of single effects, how many were noticed at all '
                 'and how many named, over their size (bars: 95 %, Wilson). Right: of claims in '
                 'order of confidence, how many are wrong, over how many answers make one.')


def _power(axes, lines):
    middles = np.array([np.sqrt(low * high) for low, high in BINS])
    for k, (word, colour, shape) in enumerate(CURVES):
        some = [line for line in lines if line['what'].startswith(word)]
        there = np.array([line['of'] > 0 for line in some])
        value, low, high = (np.array([np.nan if line[key] is None else line[key] for line in some])
                            for key in ('share_percent', 'low_percent', 'high_percent'))
        axes.errorbar((middles * APART**(2 * k - 1))[there], value[there],
                      [(value - low)[there], (high - value)[there]], color=colour, marker=shape,
                      capsize=3, label=word)
    axes.set_xscale('log')
    axes.set_xticks([low for low, _ in BINS] + [BINS[-1][1]])
    axes.xaxis.set_major_formatter('{x:g}')
    axes.minorticks_off()
    axes.set_ylim(-4, 124)      # room for the legend over the bars
    axes.set_yticks(range(0, 101, 20))
    axes.set_xlabel('size of the effect / typical size')
    axes.set_ylabel('share of singles / %')
    axes.legend(loc='upper left', ncols=2)


def _risk(axes, points):
    axes.step([0.0, *(p['coverage_percent'] for p in points)],
              [0.0, *(p['risk_percent'] for p in points)], where='post', color=GOAL)
    axes.set_xlim(0, 100)
    axes.set_ylim(-0.5, max([10.0, *(1.1 * p['risk_percent'] for p in points)]))
    axes.set_xlabel('answers that claim something / %')
    axes.set_ylabel('wrong among them / %')
