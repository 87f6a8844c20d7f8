"""Figure 3.2: manipulability (3.25) over the pad plane, three against four pads, three tasks."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from arm_brachy.control.goal import task
from arm_brachy.control.manipulability import index_map
from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.core.scene import load_scene
from arm_brachy.evaluation import style
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.tissue.build import build_body
from arm_brachy.tissue.jacobian import directed_jacobian
from arm_brachy.tissue.mesh import boundary_faces, embed
from arm_brachy.tissue.newton import StaticSolver

NAME = 'figure-3.2'
SCENES = {3: 'breast_3pads.yaml', 4: 'breast.yaml'}
TASKS = {1: '5 mm along $-x$, $y$ free', 2: '5 mm along $-y$, $x$ free',
         3: '5 mm along $+x$ and $+y$'}
SEED = 0  # nothing here is random; the form of a result has a seed

# The five targets lie within 18 mm of the axis and the pads' faces 57 mm or more from it. Inside
# 40 mm no point sits in the elements that a disc indents, where linear elements are worst.
RADIUS = 40e-3
SPACING = 2e-3    # m; a fifth of the edge length of the mesh


@dataclass(frozen=True)
class PadMap:
    """One panel: index (k,) and attained share (k,) of one task at points (k, 2) [m]."""

    n_pads: int
    task: int
    index: np.ndarray
    share: np.ndarray


def reproduce(out_dir):
    """Compute the six maps and draw them into figure-3.2.png.

    out_dir : folder that receives it.  Returns Result, a row for each map.
    """
    scenes = {n: load_scene(config_dir() / 'scenes' / file) for n, file in SCENES.items()}
    bodies = {n: build_body(scene) for n, scene in scenes.items()}
    points = grid()
    maps = [PadMap(n, k, *_map(bodies[n], points, k)) for k in TASKS for n in bodies]
    draw(maps, points, bodies).savefig(Path(out_dir) / f'{NAME}.png', dpi=150)
    return Result(NAME, SEED, commit_of(share_dir()), machine_description(),
                  tuple(_row(m) for m in maps), _targets(maps))


def grid():
    """Points (k, 2) [m] of a square grid within RADIUS of the axis; each stands for equal area."""
    line = np.arange(-RADIUS + SPACING / 2, RADIUS, SPACING)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return points[np.hypot(*points.T) <= RADIUS]


def _map(body, points, number):
    """Index and attained share of a task, linearised at rest as in the thesis."""
    height = np.mean([pad.centre[2] for pad in body.pads])
    where = np.column_stack([points, np.full(len(points), height)])
    J = directed_jacobian(StaticSolver(body), body.mesh.nodes, embed(body.mesh, where))
    goal = task(number, 'point')
    return index_map(J, goal.value, goal.axes)


def _row(m):
    return {'task': m.task, 'pads': m.n_pads, 'index_median_mm_per_mm': float(np.median(m.index)),
            'index_min_mm_per_mm': float(m.index.min()),
            'index_max_mm_per_mm': float(m.index.max()),
            'task_attained_area_percent': float(100.0 * np.mean(m.share > 1.0 - 1e-3))}


def _targets(maps):
    """The claim of the thesis: four pads beat three in the majority of the area.

    A pad that does not push is held, and (3.23) holds the tissue under it. In task 2 one pad does
    the work in both configurations, at the same place; the fourth, opposite, only stands against
    it. There the claim fails by construction wherever that pad is near.
    """
    shares = _shares(maps)
    named = {f'task {k}': shares[k] for k in TASKS} | {'all tasks': np.mean(list(shares.values()))}
    return tuple(Target(f'share of the area where four pads beat three, {name}', float(share), '%',
                        '> 50', bool(share > 50.0)) for name, share in named.items())


def _shares(maps):
    """Task -> percent of the area where four pads have the larger index."""
    by_key = {(m.n_pads, m.task): m.index for m in maps}
    return {k: 100.0 * float(np.mean(by_key[4, k] > by_key[3, k])) for k in TASKS}


@style.styled
def draw(maps, points, bodies):
    """Return the figure: rows are pad counts, columns are tasks, one colour scale for all.

    maps : PadMaps;  points : (k, 2) [m];  bodies : pad count -> SoftBody, for outline and pads
    """
    figure = Figure(figsize=(10.4, 6.6), layout='constrained')
    axes = figure.subplots(len(bodies), len(TASKS), sharex=True, sharey=True)
    limits = min(m.index.min() for m in maps), max(m.index.max() for m in maps)
    counts, tasks, shares = sorted(bodies), list(TASKS), _shares(maps)
    for m in maps:
        ax = axes[counts.index(m.n_pads), tasks.index(m.task)]
        image = _panel(ax, m, points, bodies[m.n_pads], limits)
        if m.n_pads == counts[0]:
            ax.set_title(f'Task {m.task}: {TASKS[m.task]}')
        else:
            ax.set_xlabel('x [mm]')
            _note(ax, 0.92, f'beats 3 pads on {shares[m.task]:.0f} % of the area')
        if m.task == tasks[0]:
            ax.set_ylabel(f'{m.n_pads} pads\ny [mm]')
    bar = figure.colorbar(image, ax=axes, shrink=0.9, pad=0.015,
                          ticks=[0.02, 0.05, 0.1, 0.2, 0.5], format='%g')
    bar.minorticks_off()
    bar.set_label('manipulability index: target travel / summed pad travel [mm/mm]')
    return figure


def _panel(ax, m, points, body, limits):
    edge = style.MM * RADIUS
    index = np.floor((points + RADIUS) / SPACING).astype(int)
    picture = np.full((index.max() + 1,) * 2, np.nan)
    picture[index[:, 1], index[:, 0]] = m.index
    image = ax.imshow(picture, origin='lower', extent=(-edge, edge, -edge, edge), cmap='viridis',
                      norm=LogNorm(*limits), interpolation='nearest')
    _outline(ax, body)
    for pad in body.pads:
        _draw_pad(ax, pad)
    _task_arrow(ax, m.task)
    ax.set(xlim=(-86, 86), ylim=(-86, 86), aspect='equal', xticks=range(-80, 81, 40),
           yticks=range(-80, 81, 40))
    ax.grid(False)
    _note(ax, 0.03, f'median {np.median(m.index):.2f}')
    return image


def _note(ax, height, text):
    ax.text(0.03, height, text, transform=ax.transAxes, fontsize=8.5)


def _outline(ax, body):
    """Where the pad plane cuts the surface."""
    height = np.mean([pad.centre[2] for pad in body.pads])
    corners = body.mesh.nodes[boundary_faces(body.mesh)]
    above = corners[..., 2] > height
    for triangle in corners[above.any(axis=1) & ~above.all(axis=1)]:
        ends = [a + (height - a[2]) / (b[2] - a[2]) * (b - a)
                for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True)
                if (a[2] > height) != (b[2] > height)]
        ax.plot(*(style.MM * np.array(ends))[:, :2].T, color=style.INK, linewidth=1.0)


def _draw_pad(ax, pad):
    """The disc seen edge on, and the way it pushes."""
    across = np.array([-pad.direction[1], pad.direction[0]]) * style.MM
    centre, push = style.MM * pad.centre[:2], pad.direction[:2]
    half = 10e-3
    ax.plot(*np.column_stack([centre - half * across, centre + half * across]),
            color=style.GOAL, linewidth=4.0, solid_capstyle='butt')
    ax.annotate('', xy=centre - 1.5 * push, xytext=centre - 17.0 * push,
                arrowprops={'arrowstyle': '-|>', 'color': style.GOAL, 'linewidth': 1.5})


def _task_arrow(ax, number):
    way = np.array(task(number, 'point').value[:2])
    way = 22.0 * way / np.linalg.norm(way)
    ax.annotate('', xy=way / 2, xytext=-way / 2,
                arrowprops={'arrowstyle': '-|>', 'color': 'black', 'linewidth': 2.0,
                            'mutation_scale': 18, 'shrinkA': 0, 'shrinkB': 0,
                            'path_effects': [withStroke(linewidth=4.0, foreground='white')]})
