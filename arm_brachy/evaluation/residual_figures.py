"""Figures of a replay: residual of every marker or pad over time, as a norm and per axis."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.evaluation.style import BAND, INK, OURS, SERIES, Plate, new_figure, styled

COLUMNS = 3


@dataclass(frozen=True)
class Words:
    """How a kind of ResidualData is spoken of: what carries a value, its unit, its scale."""

    carrier: str
    plural: str
    unit: str
    scale: float


WORDS = {'position': Words('marker', 'markers', 'mm', 1e3),
         'force': Words('pad', 'pads', 'N', 1.0)}
SHADES = ('#f6f1dd', '#dde9f3', '#e2f1dc', '#f5e0ea', '#e6e6e6')
NARROW = 0.12  # of the axis; a narrower stretch has no room for its name
FEW = 6  # up to so many stretches each is named in the panel, beyond that in the caption only


@styled
def residual_norms(data, r, floor):
    """|r| of every marker over time against the noise floor, one panel per marker.

    data : timeseries.ResidualData;  r : (n, k, 3) [m or N];  floor : (k,) rms noise norm
    For who asks: where and when does the model miss something, and by how much?
    """
    words, (figure, axes) = WORDS[data.kind], _panels(data)
    size = np.linalg.norm(r, axis=2) * words.scale
    for k, axis in enumerate(axes):
        axis.plot(data.t, size[:, k], color=OURS, lw=1.0, rasterized=True)
        axis.axhline(floor[k] * words.scale, color=BAND, lw=1.2)
    if np.nanmax(size, initial=0.0) > 0.0:
        axes[0].set_ylim(0.0, 1.18 * np.nanmax(size))
    _label(figure, axes, f'residual / {words.unit}')
    return Plate('residual_norms', figure, (
        f'Length of measured minus predicted for every {words.carrier} (blue) and the rms that '
        'measurement noise alone would leave (green). ' + _regimes_in_words(data)))


@styled
def residual_axes(data, r):
    """Residual of every marker per axis over time; its direction tells the kind of error."""
    words, (figure, axes) = WORDS[data.kind], _panels(data)
    for k, axis in enumerate(axes):
        for i, name in enumerate('xyz'):
            axis.plot(data.t, r[:, k, i] * words.scale, color=SERIES[i], lw=0.9, label=name,
                      rasterized=True)
        axis.axhline(0.0, color=INK, lw=0.6)
    low, high = axes[0].get_ylim()
    axes[0].set_ylim(low, high + 0.18 * (high - low))
    _label(figure, axes, f'residual / {words.unit}')
    figure.legend(*axes[0].get_legend_handles_labels(), loc='outside upper center', ncols=3)
    return Plate('residual_axes', figure, (
        'Residual, measured minus predicted, along each axis of the model frame. '
        + _regimes_in_words(data)))


def _panels(data):
    count = len(data.names)
    columns = 2 if count == 4 else min(COLUMNS, count)
    rows = -(-count // columns)
    figure = new_figure(9.5, 0.9 + 1.7 * rows)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    axes = grid.ravel()
    for spare in axes[len(data.names):]:
        spare.set_visible(False)
    for k, axis in enumerate(axes[:len(data.names)]):
        axis.set_title(data.names[k])
        _shade_regimes(axis, data, named=k < columns and len(data.regimes) <= FEW)
    return figure, axes[:len(data.names)]


def _regime_names(data):
    return list(dict.fromkeys(g.name for g in data.regimes))


def _shade_regimes(axis, data, *, named):
    shade = dict(zip(_regime_names(data), SHADES, strict=False))
    for regime in data.regimes:
        axis.axvspan(regime.t_start, regime.t_end, color=shade[regime.name], lw=0, zorder=0)
        if named and regime.t_end - regime.t_start > NARROW * (data.t[-1] - data.t[0]):
            axis.text(regime.t_start, 0.97, ' ' + regime.name, fontsize=7, va='top',
                      color='#55636e', transform=axis.get_xaxis_transform())


def _label(figure, axes, quantity):
    figure.supxlabel('time / s', fontsize=9)
    figure.supylabel(quantity, fontsize=9)
    axes[0].set_xlim(auto=True)
    axes[0].margins(x=0.0)


def _regimes_in_words(data):
    if not data.regimes:
        return ''
    stretches = {name: [g for g in data.regimes if g.name == name] for name in _regime_names(data)}
    if len(data.regimes) <= FEW:
        parts = [f'{g.name} ({g.t_start:.2f}–{g.t_end:.2f} s)' for g in data.regimes]
    else:
        colours = dict(zip(stretches, ('sand', 'blue', 'green', 'rose', 'grey'), strict=False))
        parts = [f'{name} ({colours[name]}, {len(found)} stretches, '
                 f'{sum(g.t_end - g.t_start for g in found):.1f} s)'
                 for name, found in stretches.items()]
    return 'Shaded: ' + ', '.join(parts) + '.'
