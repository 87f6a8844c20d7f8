"""Figures of a procedure. Each function returns a style.Plate."""

import numpy as np
from matplotlib.collections import PolyCollection

from arm_brachy.evaluation.deformation import boundary_triangles
from arm_brachy.evaluation.procedure_data import sampled, vector
from arm_brachy.evaluation.procedure_force import true_force
from arm_brachy.evaluation.procedure_metrics import (
    IN_PLANE,
    hole_axis,
    out_of_plane,
    planned_path,
)
from arm_brachy.evaluation.style import (
    BAND,
    GOAL,
    INK,
    MEASURED,
    MM,
    OURS,
    SERIES,
    TRUTH,
    Plate,
    colour,
    new_figure,
    styled,
)

MOST_FRAMES = 4      # pictures side by side that stay legible
FACE = 19e-3         # m, half the width of the probe's face as it is drawn
PLANE = 38e-3        # m, depth of the image plane as it is drawn
FORCE_POINTS = 4000  # of the curve of force: more are no wider than its line
VIEWS = (('from above (along −z)', 0, 1, 2, 1.0), ('from the side (along +y)', 0, 2, 1, -1.0))


@styled
def tip_over_depth(data):
    """Where the tip was against plane, image and hole while it went in."""
    window = data.when('inserting')
    tip = data.tip.between(*window)
    hole, axis = vector(data.plan['hole_m']), hole_axis(data)
    depth = (tip.values - hole) @ axis
    figure = new_figure(9.5, 6.2)
    plane, image, path = figure.subplots(3, 1, sharex=True)
    plane.axhspan(-IN_PLANE * MM, IN_PLANE * MM, color=BAND, alpha=0.2, lw=0, label='goal')
    plane.plot(depth * MM, out_of_plane(tip, data.probe).values * MM, color=TRUTH,
               label='true tip to image plane')
    plane.set_ylabel('out of plane\n/ mm')
    _draw_image_error(image, data, window, hole, axis)
    off = tip.values - hole
    off = off - np.multiply.outer(off @ axis, axis)
    path.plot(depth * MM, np.linalg.norm(off, axis=1) * MM, color=TRUTH,
              label="from the hole's axis")
    path.plot(depth * MM, np.linalg.norm(planned_path(data, tip.values), axis=1) * MM, '--',
              color=GOAL, label='of the planned path')
    path.set_ylabel('off axis\n/ mm')
    path.set_xlabel('depth of the tip along the hole / mm')
    for one in (plane, image, path):
        one.legend(loc='best', ncols=3)
    figure.align_ylabels([plane, image, path])
    return Plate('tip_over_depth', figure, (
        'The true tip over its depth, during the insertion. Top: its distance from the image '
        f'plane, goal ±{IN_PLANE * MM:g} mm. Middle: tip found in the image, placed by the '
        'encoders of the arm, less the true tip. Bottom: distance of the tip from the axis of its '
        'hole, which a bevel makes grow, and that of the planned path where it is as deep.'))


def _draw_image_error(axes, data, window, hole, axis):
    axes.set_ylabel('image less truth\n/ mm')
    if data.tip_image is None:
        axes.text(0.5, 0.5, 'the tip was never found', transform=axes.transAxes, ha='center')
        return
    seen = data.tip_image.between(*window)
    true = np.column_stack([np.interp(seen.t, data.tip.t, c) for c in data.tip.values.T])
    pose = sampled(data.probe, seen.t)
    off = seen.values - true
    for column, name, look in ((0, 'along the elements', SERIES[0]), (2, 'with depth', SERIES[1])):
        part = np.einsum('ni,ni->n', pose[:, column:9:3], off)
        axes.plot((true - hole) @ axis * MM, part * MM, '.', color=look, markersize=3, label=name)
    axes.axhline(0.0, color=INK, lw=0.6)


@styled
def contact_force(data):
    """Contact force of the probe, force on the needle and its depth over time."""
    figure = new_figure(9.5, 5.2)
    force, depth = figure.subplots(2, 1, sharex=True, gridspec_kw={'height_ratios': (1.3, 1)})
    every = max(1, len(data.force.t) // FORCE_POINTS)
    force.plot(data.force.t[::every], data.force.values[::every], color=MEASURED, lw=0.7,
               label='measured', rasterized=True)
    truth = true_force(data)
    if truth is not None:
        force.plot(truth.t, truth.values, color=TRUTH, lw=1.0, label='true')
    force.plot(data.state.t, data.state.values[:, 2], color=GOAL, ls='--', lw=1.1, label='goal')
    force.set_ylabel('probe on tissue / N')
    force.legend(loc='center left', ncols=1)
    depth.plot(data.needle.t, data.needle.values[:, 0] * MM, color=OURS, label='depth / mm')
    depth.set_ylabel('needle depth / mm')
    load = depth.twinx()
    load.plot(data.needle.t, data.needle.values[:, 2], color=SERIES[1], lw=0.9)
    load.set_ylabel('force along the needle / N')
    load.grid(visible=False)
    depth.set_xlabel('time / s')
    _mark_steps(force, data, data.force.t[-1])
    return Plate('contact_force', figure, (
        'Top: force of the probe on the tissue as measured at every period of the controller, '
        "the true one, from which the sensor's zero drifts away, and the goal; the steps of the "
        'procedure are named above. Bottom: depth of the needle (blue) '
        'and force of the tissue along it (orange), positive against insertion.'))


def _mark_steps(axes, data, end):
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.25 * (high - low))
    times = [*(t for t, _ in data.steps), end]
    for (t, said), later in zip(data.steps, times[1:], strict=True):
        axes.axvline(t, color='#9aa5ad', lw=0.6)
        if later - t > 0.06 * (end - times[0]):
            axes.text((t + later) / 2, 0.97, said['phase'], transform=axes.get_xaxis_transform(),
                      ha='center', va='top', rotation=20 if later - t < 0.12 * end else 0,
                      fontsize=7.5)


@styled
def ultrasound(data):
    """A few pictures of the imager, with the template's holes and the tip."""
    shown = chosen(data)
    height = 9.5 / MOST_FRAMES * shown[0].picture.shape[0] / shown[0].picture.shape[1]
    figure = new_figure(9.5, height + 0.5)
    for axes, frame in zip(np.ravel(figure.subplots(1, MOST_FRAMES)), [*shown, *[None] * (
            MOST_FRAMES - len(shown))], strict=True):
        axes.set_axis_off()
        if frame is not None:
            axes.imshow(frame.picture, interpolation='antialiased')
            axes.set_title(f't = {frame.t:.1f} s', fontweight='normal')
    return Plate('ultrasound', figure, (
        'Ultrasound as the person saw it, transducer above. Marks: where the axes of the holes of '
        'the template pierce the image plane (green), the tip as told (cross) and as found '
        "(circle), where it will be at the target's depth (diamond) and is to be (square)."))


def chosen(data):
    """At most MOST_FRAMES of the frames, spread over the insertion and the dwell."""
    window = data.when('inserting') or (-np.inf, np.inf)
    dwell = data.when('dwelling') or window
    inside = [f for f in data.frames if window[0] <= f.t <= dwell[1]] or list(data.frames)
    index = np.unique(np.linspace(0, len(inside) - 1, MOST_FRAMES).round().astype(int))
    return [inside[i] for i in index]


@styled
def cell(data, tissue, pads):
    """Arm, probe, needle and template over the body, from above and from the side.

    tissue : timeseries.Tissue;  pads : timeseries.PadMark
    """
    shot = data.picture
    index = int(np.abs(tissue.t - shot.t).argmin())
    x, faces = tissue.positions[index], boundary_triangles(tissue.tets)
    figure = new_figure(9.5, 4.8)
    for axes, (name, a, b, c, sign) in zip(figure.subplots(1, 2), VIEWS, strict=True):
        corners = x[faces]
        order = np.argsort(sign * corners[:, :, c].mean(axis=1))
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        shade = 0.62 + 0.33 * np.clip(normal @ np.array([0.3, -0.4, 0.85]), 0, 1)
        axes.add_collection(PolyCollection(
            corners[order][:, :, (a, b)] * MM,
            facecolors=np.column_stack([shade, 0.93 * shade, 0.88 * shade])[order], lw=0,
            antialiased=False, rasterized=True))
        _draw_instruments(axes, shot, pads, a, b)
        axes.set_title(name)
        axes.set_aspect('equal')
        axes.autoscale_view()
        axes.set_xlabel(f'{"xyz"[a]} / mm')
        axes.set_ylabel(f'{"xyz"[b]} / mm')
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc='outside upper center',
                  ncols=6)
    return Plate('cell', figure, (
        f'The cell at t = {shot.t:.1f} s, true to scale: body, pads, holes of the template, '
        "needle, and the arm's joints as a line to the probe. Blue: image plane below the face "
        'of the probe.'))


def _draw_instruments(axes, shot, pads, a, b):
    at = [a, b]
    for i, pad in enumerate(pads):
        axes.plot(*(pad.centre[at] * MM), 'o', color=colour(i), label=pad.name)
    axes.plot(*(shot.holes[:, at].T * MM), '.', color='#9aa5ad', markersize=2, label='holes')
    R, p = shot.R, shot.p
    plane = np.array([p + s * FACE * R[:, 0] + d * PLANE * R[:, 2]
                      for s, d in ((-1, 0), (1, 0), (1, 1), (-1, 1))])
    axes.fill(*(plane[:, at].T * MM), color=OURS, alpha=0.25, lw=0.8, label='image plane')
    axes.plot(*(shot.shaft[:, at].T * MM), color=INK, lw=1.6, label='needle')
    if len(shot.line):
        axes.plot(*(np.vstack([shot.line, p])[:, at].T * MM), '-o', color=GOAL, lw=3.0, alpha=0.8,
                  markersize=5, label='arm')


def plates(run):
    """The figures that a RunData with a procedure allows, in order."""
    data, drawn = run.procedure, []
    if data.picture is not None and run.tissue is not None:
        drawn.append(cell(data, run.tissue, run.pads))
    if data.frames:
        drawn.append(ultrasound(data))
    if data.when('inserting') is not None and data.tip is not None and data.probe is not None:
        drawn.append(tip_over_depth(data))
    if data.force is not None and data.needle is not None and len(data.force.t):
        drawn.append(contact_force(data))
    return drawn
