"""Figures of a diagnosis: where on the body, when in the recordings, how well it fits."""

from dataclasses import dataclass

import numpy as np

from arm_brachy.cell import pad_directions
from arm_brachy.core.errors import InputError
from arm_brachy.diagnosis.report.localisation import under
from arm_brachy.diagnosis.results import formatting
from arm_brachy.diagnosis.results.formatting import STREAMS
from arm_brachy.diagnosis.results.parts import edge_unit
from arm_brachy.diagnosis.signals.stream import OPTICAL
from arm_brachy.evaluation.body_place import Body, Spot, body_place
from arm_brachy.evaluation.style import BAND, GOAL, INK, MEASURED, OURS, Plate, new_figure, styled
from arm_brachy.evaluation.timeseries import PadMark

UNEXPLAINED = 'unexplained'   # what is drawn at a place of which it is not known what is there
MOST_COLUMNS = 3    # recordings side by side; with more the axes are too narrow to read
LINE = 0.1      # of the height of a panel: a line of text
SHADE = '#e9eef2'
WIDE = 0.6          # of a recording: what lasts longer is told in words, not shaded
GREY = '#b9c3ca'


@dataclass(frozen=True)
class Trace:
    """Residual of one stream over one recording.

    t : (n,) [s];  recalibrated : (n,) root mean square over channels and axes [m or N], without
    new physics;  named : (n,) with the causes that were found, None if none was
    floor : rms that noise alone leaves [m or N]
    """

    recording: str
    stream: str
    t: np.ndarray
    recalibrated: np.ndarray
    floor: float
    named: np.ndarray | None = None

    def __post_init__(self):
        for name in ('recalibrated', 'named'):
            values = getattr(self, name)
            if values is not None and np.shape(values) != np.shape(self.t):
                raise InputError(f'trace of {self.stream} in {self.recording}: {name} has shape '
                                 f'{np.shape(values)}; must be that of t, {np.shape(self.t)}')


def body_of(scene, mesh):
    """The Body that is drawn, of a core.scene.Scene and its tissue.body.TetMesh."""
    pads = tuple(PadMark(pad.name, np.array(pad.centre), direction)
                 for pad, direction in zip(scene.pads, pad_directions(scene), strict=True))
    return Body(mesh.nodes, mesh.tets, pads, {m.name: np.array(m.position)
                                              for m in scene.markers})


def where_plate(d, body):
    """The places of Diagnosis `d` on a body_place.Body; None if none of them can be drawn."""
    spots = [_spot(d, place) for place in d.where if place.position is not None]
    pads = {place.actuator for place in d.where if place.actuator}
    markers = [place.channel for place in d.where if place.stream == OPTICAL and place.channel]
    pads |= {p.channel for p in d.where if p.stream in ('force', 'encoder') and p.channel}
    pads |= {pad.name for pad in body.pads if under(pad.name) in {p.boundary for p in d.where}}
    if not (spots or pads or markers):
        return None
    return body_place(body, spots, pads, markers, _where_caption(spots, pads, markers))


def _spot(d, place):
    label = formatting.spoken(place.term) if place.term else UNEXPLAINED
    return Spot(np.asarray(place.position), place.radius, label,
                sure=d.verdict == 'named' and bool(place.term))


def _where_caption(spots, pads, markers):
    parts = ['The body at rest, true to scale; dots: markers; arrows: pads and the way '
             'they push (a cross: away from the reader).']
    if spots:
        parts.append(f'{_circles(spots)}, drawn through the surface.')
    if pads or markers:
        parts.append(f'In orange: {formatting.listed(sorted({*pads, *markers}))}.')
    return ' '.join(parts)


def _circles(spots):
    """What the circles around Spots are."""
    if all(spot.label == UNEXPLAINED for spot in spots):
        return 'Dashed circles: where something is left'
    dashed = ' (dashed: not certain what is there)' if not all(s.sure for s in spots) else ''
    return f'Circles: 90 % regions of the place{dashed}'


@styled
def when_plate(d, traces):
    """Residuals over time against the noise floor, intervals of Diagnosis `d` marked.

    traces : Trace each.  Recordings in which something was found come first; the caption says
    which were left out.
    """
    streams = list(dict.fromkeys(trace.stream for trace in traces))
    recordings = _recordings(d, traces)
    shown = recordings[:MOST_COLUMNS]
    figure = new_figure(9.5, 0.8 + 1.75 * len(streams))
    axes = figure.subplots(len(streams), len(shown), sharex='col', sharey='row', squeeze=False)
    for trace in traces:
        if trace.recording in shown:
            _draw_trace(axes[streams.index(trace.stream), shown.index(trace.recording)], trace)
    for k, recording in enumerate(shown):
        axes[0, k].set_title(recording)
        marked = [i for i in d.when if i.recording == recording]
        for row, axis in enumerate(axes[:, k]):
            _mark(axis, marked, named=row == 0)
    for row, stream in enumerate(streams):
        axes[row, 0].set_ylabel(f'{STREAMS[stream][0]}\nresidual / {edge_unit(stream)[0]}')
        _fit_axis(axes[row])
    figure.supxlabel('time / s', fontsize=9)
    lines = {label: line for line, label in zip(*axes[0, 0].get_legend_handles_labels(),
                                                strict=True)}
    figure.legend(lines.values(), lines.keys(), loc='outside upper center', ncols=4)
    return Plate('when', figure, _when_caption(d, recordings[MOST_COLUMNS:]))


def _recordings(d, traces):
    marked = [interval.recording for interval in d.when]
    names = dict.fromkeys(trace.recording for trace in traces)
    return sorted(names, key=lambda name: name not in marked)


def _draw_trace(axis, trace):
    scale = edge_unit(trace.stream)[1]
    axis.plot(trace.t, trace.recalibrated / scale, color=MEASURED, lw=1.0, rasterized=True,
              label='recalibrated, no new physics')
    if trace.named is not None:
        axis.plot(trace.t, trace.named / scale, color=OURS, lw=1.0, rasterized=True,
                  label='with what was found')
    axis.axhline(trace.floor / scale, color=BAND, lw=1.3, label='noise alone')
    axis.set_xlim(trace.t[0], trace.t[-1])


def _mark(axis, intervals, *, named):
    lines = {}      # label -> number of its line: what overlaps in time is not written over
    for one in intervals:
        left, right = axis.get_xlim()
        wide = one.t_end - one.t_start > WIDE * (right - left)
        if not wide:
            axis.axvspan(one.t_start, one.t_end, color=SHADE, lw=0, zorder=0)
        if one.onset is not None:
            axis.axvline(float(np.mean(one.onset)), color=GOAL, lw=1.3, zorder=1)
        label = one.term or one.regime
        if named and label and label not in lines:
            lines[label] = len(lines)
            late = one.t_start > 0.5 * (left + right)
            share = ', throughout' if wide else ''
            axis.text(one.t_end if late else one.t_start, 0.97 - LINE * lines[label],
                      f' {formatting.spoken(label)}{share} ', fontsize=7.5, va='top',
                      ha='right' if late else 'left', color=GOAL,
                      transform=axis.get_xaxis_transform())


def _fit_axis(row):
    top = max((np.nanmax(line.get_ydata()) for axis in row for line in axis.get_lines()
               if len(line.get_xdata()) > 2), default=1.0)
    row[0].set_ylim(0.0, 1.3 * top)


def _when_caption(d, left_out):
    text = ('Residual, measured minus predicted, as the root mean square over channels and axes; '
            'the model without new physics has its parameters refitted.')
    if d.when:
        text += (f' Shaded: when it shows, where that is less than {WIDE:.0%} of the recording'
                 + ('; line: sudden beginning.' if any(i.onset for i in d.when) else '.'))
    if left_out:
        count = len(left_out)
        text += f' {count} more recording{"s" if count > 1 else ""} not drawn.'
    return text


@styled
def fit_plate(d):
    """Held-out errors of Diagnosis `d`: as given, recalibrated, with the causes, and noise."""
    figure = new_figure(9.5, 2.1)
    axes = figure.subplots(1, len(d.fit), squeeze=False)[0]
    for axis, one in zip(axes, d.fit, strict=True):
        unit, scale = edge_unit(one.stream)
        bars = [('as given', one.as_given, GREY), ('recalibrated', one.recalibrated, MEASURED)]
        bars += [] if one.named is None else [('with what was found', one.named, OURS)]
        values = [value / scale for _, value, _ in bars]
        drawn = axis.barh([name for name, _, _ in bars], values, color=[c for _, _, c in bars],
                          height=0.62)
        texts = formatting.figures((*values, one.noise_floor / scale))
        axis.bar_label(drawn, texts[:-1], padding=4, fontsize=8.5)
        axis.axvline(one.noise_floor / scale, color=BAND, lw=1.6)
        axis.invert_yaxis()
        axis.set_xlim(0.0, 1.22 * max(*values, one.noise_floor / scale))
        axis.set(title=f'{STREAMS[one.stream][0]}\nnoise alone: {texts[-1]} {unit}',
                 xlabel=f'held-out error, rms / {unit}')
        axis.locator_params(axis='x', nbins=5)
        axis.grid(visible=False, axis='y')
        axis.tick_params(axis='y', length=0, colors=INK)
    for axis in axes[1:]:
        axis.set_yticklabels([])
    held_out = formatting.listed(
        dict.fromkeys(one.held_out for one in d.fit if one.held_out) or [''])
    return Plate('fit', figure, (
        'Root mean square error per axis on what was not used for the fit'
        + (f' ({held_out})' if held_out else '') + '. Green: what a perfect model on a perfect '
        'mesh would leave.'))
