"""Appendix A: the spherical scissor linkage. Kinematics, stiffness, isotropy, design.

What the corrected formulas give stands beside what is printed. The two-objective design chooses
links, section and material with N beta = 90 deg and no more mass than the thesis' design.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.image import imsave
from pymoo.algorithms.moo.nsga2 import RankAndCrowdingSurvival
from pymoo.core.mixed import MixedVariableGA
from pymoo.core.problem import ElementwiseProblem
from pymoo.core.variable import Choice, Integer, Real
from pymoo.optimize import minimize

from arm_brachy.core.paths import config_dir, share_dir
from arm_brachy.evaluation.result import Result, Target, commit_of, machine_description
from arm_brachy.evaluation.style import GOAL, INK, OURS, SERIES, THEIRS, Plate, new_figure, styled
from arm_brachy.experiments import scissor_frame
from arm_brachy.robot.scissor_drawing import ScissorDrawing
from arm_brachy.robot.scissor_place import base_axes
from arm_brachy.robot.scissor_rcm import (
    MEASURES,
    RIGHT_ANGLE,
    ScissorParams,
    branch,
    clear_range,
    global_conditioning,
    isotropy,
    passive_angles,
    polar_angle,
    tip,
)
from arm_brachy.robot.scissor_stiffness import (
    Section,
    radial_stiffness,
    thesis_stiffness,
    torsional_spring,
)
from arm_brachy.scenario import load_cell
from arm_brachy.tissue.build import load_scene_mesh
from arm_brachy.tissue.mesh import surface_triangles

NAME = 'appendix-a'
SEED = 3
THESIS = {'beta_deg': 18.21, 'gci': 0.45, 'stiffness_N_m': 1.99e5, 'least_isotropy': 0.0382}
LINKS = range(2, 10)        # beta from 45 to 10 deg, the thesis' range
OPENINGS = 12               # theta_1 at which the least stiffness over the workspace is looked for
BENDING = np.radians(1.0)   # of every link, for the closure of flexible stages
# Pa, kg/m3; isotropic ones, for which the formulas hold
MATERIALS = {'aluminium': (70e9, 2700.0), 'steel': (200e9, 7850.0), 'titanium': (114e9, 4430.0)}
POPULATION, GENERATIONS = 24, 16
HOLDER = 'probe_scissor'    # the scenario whose linkage is drawn over its body
# rad, rad, rad, m: theta_0, theta_1, spin and advance of that drawing, the probe on the skin
DRAWN = (np.radians(25.0), np.radians(46.0), np.radians(-100.0), 0.182)
PIXELS = (960, 720)


def design(links, **changed):
    """The thesis' linkage with so many links a branch and links * beta = 90 deg."""
    return replace(ScissorParams(links=links, beta=RIGHT_ANGLE / links), **changed)


def least_stiffness(params, stiffness=radial_stiffness):
    """Return the least radial stiffness [N/m] over the openings at which no links touch."""
    low, high = clear_range(params)
    return min(stiffness(params, t) for t in np.linspace(low, high, OPENINGS))


def mass(params, density):
    """Mass [kg] of all arcs."""
    return 2 * params.links * params.beta * params.radius * Section.of(params).area * density


def reproduce(out_dir):
    """Compute all of appendix A; write JSON and PNG into `out_dir`; return the Result."""
    out_dir, prototype = Path(out_dir), ScissorParams()
    table = [_design_row(links) for links in LINKS]
    frame = [_frame_row(prototype, t) for t in np.linspace(0.1, 1.45, 10)]
    front = pareto_front()
    gap, off = closure_errors(prototype)
    index = {m: global_conditioning(prototype, m) for m in MEASURES}
    worst = max(abs(r['relative_difference']) for r in frame)
    targets = (
        Target('distance of the tip from the centre less 0.24 m', off, 'm', '<= 1e-9',
               off <= 1e-9),
        Target('gap between branches, rigid and bent by 1 deg', gap, 'm', '<= 1e-9', gap <= 1e-9),
        Target('stiffness against the beam model, worst of ten', worst, '1', '<= 0.05',
               worst <= 0.05),
        Target('GCI, mean over the polar angle', index['polar'], '1', '0.405 to 0.495',
               bool(0.405 <= index['polar'] <= 0.495)))
    result = Result(NAME, SEED, commit_of(share_dir()), str(machine_description()),
                    (*_printed_rows(prototype, index), *table, *frame, *front,
                     _design_row(2, 'one rhombus of 45 deg links, as ARAS-DIAMOND')), targets)
    result.to_json(out_dir / f'{NAME}.json')
    figure(table, front).save(out_dir / f'{NAME}.png')
    picture(prototype).save(out_dir / f'{NAME}-linkage.png')
    imsave(out_dir / f'{NAME}-holder.png', holder_picture())
    return result


def closure_errors(params):
    """Worst gap between branches and worst distance error of the tip [m] over the workspace."""
    gaps, off = [], []
    for bend in (0.0, BENDING):
        gamma = np.full(params.links, bend)
        for t in np.linspace(0.05, 1.5, 30):
            psi = passive_angles(params, t, gamma)
            left, right = (branch(params, 0.7, t, psi, gamma, side) for side in (1, -1))
            for stage in range(params.links // 2):
                k = 2 * (2 * stage + 2) + 1
                gaps.append(np.linalg.norm(left[k][:3, 3] - right[k][:3, 3]))
            if not bend:
                centre = np.array([0.0, 0.0, -params.radius])
                off += [abs(np.linalg.norm(f[:3, 3] - centre) - params.radius)
                        for f in (left[-1], right[-1])]
                off.append(abs(np.linalg.norm(tip(params, 0.7, t)) - params.radius))
    return float(max(gaps)), float(max(off))


def _design_row(links, what='thesis section, 200 GPa'):
    p = design(links)
    flat = replace(p, width=p.thickness, thickness=p.width)
    low, high = clear_range(p)
    return {'design': what, 'links': links, 'beta_deg': float(np.degrees(p.beta)),
            'gci_polar': global_conditioning(p, 'polar'),
            'gci_joint': global_conditioning(p, 'joint'),
            'stiffness_N_m': least_stiffness(p), 'stiffness_flat_N_m': least_stiffness(flat),
            'thesis_formula_N_m': least_stiffness(p, thesis_stiffness),
            'thesis_formula_flat_N_m': least_stiffness(flat, thesis_stiffness),
            'clear_from_deg': float(np.degrees(low)), 'clear_to_deg': float(np.degrees(high))}


def _frame_row(params, theta_1):
    ours = radial_stiffness(params, theta_1)
    theirs = scissor_frame.radial_stiffness(params, theta_1)
    return {'theta_1_deg': float(np.degrees(theta_1)),
            'polar_deg': float(np.degrees(polar_angle(params, theta_1))),
            'virtual_joints_N_m': ours, 'beam_model_N_m': theirs,
            'relative_difference': ours / theirs - 1.0, 'isotropy': isotropy(params, theta_1)}


def _printed_rows(params, index):
    """What the thesis prints, what follows from its corrected formulas, and why they differ."""
    flat = replace(params, width=params.thickness, thickness=params.width)
    rows = (
        ('GCI, mean over polar angle', THESIS['gci'], index['polar'], 'measure not stated'),
        ('GCI, mean over theta_1', THESIS['gci'], index['joint'], 'measure not stated'),
        ('GCI, mean over area', THESIS['gci'], index['area'], 'measure not stated'),
        ('least isotropy', THESIS['least_isotropy'], isotropy(params, 1e-9),
         'zero at both ends of the stroke: the linkage has singularities there'),
        ('optimal link angle / deg', THESIS['beta_deg'], np.degrees(design(5).beta),
         'N beta = 90 deg leaves 18 deg for five links; 18.21 deg is no 90 / N'),
        ('least stiffness, A.13 corrected, 1 cm along the radius / N/m', THESIS['stiffness_N_m'],
         least_stiffness(flat, thesis_stiffness), 'bending of links in their plane only'),
        ('least stiffness, A.13 corrected, 3 cm along the radius / N/m', THESIS['stiffness_N_m'],
         least_stiffness(params, thesis_stiffness), 'orientation of the section not stated'),
        ('least stiffness, 3 cm along the radius, all of the beams / N/m', THESIS['stiffness_N_m'],
         least_stiffness(params), 'torsion and bending across dominate'),
        ('torsional spring at 18 deg / N m', float('nan'), torsional_spring(params),
         'as printed (A.17) would be 8.3 times as stiff'))
    return tuple({'quantity': name, 'printed': printed, 'computed': float(value), 'why': why}
                 for name, printed, value, why in rows)


class _Design(ElementwiseProblem):
    """Most stiffness and most isotropy at no more mass than the thesis' design has in steel."""

    def __init__(self):
        self._most = mass(design(5), MATERIALS['steel'][1])
        super().__init__(vars={
            'links': Integer(bounds=(LINKS[0], LINKS[-1])), 'material': Choice(
                options=list(MATERIALS)), 'width': Real(bounds=(0.008, 0.04)),
            'thickness': Real(bounds=(0.004, 0.02))}, n_obj=2, n_ieq_constr=1)

    def _evaluate(self, x, out, *_, **__):
        modulus, density = MATERIALS[x['material']]
        p = design(x['links'], E=modulus, width=x['width'], thickness=x['thickness'])
        out['F'] = [-least_stiffness(p), -global_conditioning(p, 'polar', 400)]
        out['G'] = [mass(p, density) / self._most - 1.0]


def pareto_front():
    """Rows of designs that no other beats in both stiffness and isotropy (NSGA-II, SEED)."""
    found = minimize(_Design(), MixedVariableGA(pop_size=POPULATION,
                                                survival=RankAndCrowdingSurvival()),
                     ('n_gen', GENERATIONS), seed=SEED)
    rows = [{'pareto_links': int(x['links']), 'material': str(x['material']),
             'width_mm': 1e3 * float(x['width']), 'thickness_mm': 1e3 * float(x['thickness']),
             'stiffness_N_m': -float(f[0]), 'gci_polar': -float(f[1])}
            for x, f in zip(found.X, found.F, strict=True)]
    return sorted(rows, key=lambda row: row['stiffness_N_m'])


def holder_picture():
    """Return (height, width, 3) uint8 of linkage, stage and probe over the body of HOLDER."""
    cell = load_cell(config_dir() / 'scenarios' / f'{HOLDER}.yaml')
    own, mesh = cell.scenario.probe.scissor_rcm, load_scene_mesh(cell.model)
    drawing = ScissorDrawing(own, base_axes(own.axis), own.centre)
    out = drawing.picture(DRAWN, *PIXELS, (mesh.nodes, surface_triangles(mesh)))
    drawing.close()
    return out


@styled
def figure(table, front):
    """Stiffness and isotropy over the number of links, over the stroke, and the Pareto front."""
    sheet = new_figure(9.6, 6.4)
    (a, b), (c, d) = sheet.subplots(2, 2)
    links = [row['links'] for row in table]
    a.semilogy(links, [row['stiffness_N_m'] for row in table], 'o-', color=OURS,
               label='beams, 3 cm along the radius')
    a.semilogy(links, [row['thesis_formula_flat_N_m'] for row in table], 's--', color=SERIES[1],
               label='(A.13) corrected, 1 cm')
    a.axhline(THESIS['stiffness_N_m'], color=THEIRS, label='printed')
    a.set(xlabel='links of a branch, beta = 90 deg / links', ylabel='least stiffness / N/m')
    a.set_title('Stiffness (Figure A.5)')
    a.legend()
    for key, colour in (('gci_polar', OURS), ('gci_joint', SERIES[1])):
        b.plot(links, [row[key] for row in table], 'o-', color=colour,
               label=f'mean over {"polar angle" if key == "gci_polar" else "theta_1"}')
    b.axhline(THESIS['gci'], color=THEIRS, label='printed')
    b.set(xlabel='links of a branch', ylabel='GCI', ylim=(0.0, 0.6))
    b.set_title('Global conditioning (Figure A.6)')
    b.legend(loc='lower right')
    _draw_stroke(c)
    _draw_front(d, front)
    return Plate(NAME, sheet, 'The scissor linkage: stiffness, isotropy, design.')


def _draw_stroke(axes):
    p = ScissorParams()
    t = np.linspace(0.03, RIGHT_ANGLE - 0.03, 60)
    polar = np.degrees([polar_angle(p, x) for x in t])
    axes.semilogy(polar, [radial_stiffness(p, x) for x in t], color=OURS)
    axes.set(xlabel='polar angle of the tip / deg', ylabel='radial stiffness / N/m')
    twin = axes.twinx()
    twin.plot(polar, [isotropy(p, x) for x in t], color=GOAL)
    twin.set_ylabel('isotropy', color=GOAL)
    twin.grid(False)
    axes.set_title('Over the hemisphere (Figure A.7)')


def _draw_front(axes, front):
    for k, material in enumerate(MATERIALS):
        own = [row for row in front if row['material'] == material]
        axes.semilogx([r['stiffness_N_m'] for r in own], [r['gci_polar'] for r in own], 'o',
                      color=SERIES[k], label=material)
    axes.plot(THESIS['stiffness_N_m'], THESIS['gci'], '*', ms=11, color=THEIRS,
              label='thesis, printed')
    p = design(5)
    axes.plot(least_stiffness(p), global_conditioning(p, 'polar'), '*', ms=11, color=INK,
              label="thesis' design, computed")
    axes.set(xlabel='least radial stiffness / N/m', ylabel='GCI (polar)')
    axes.set_title('Pareto front, mass as in the thesis')
    axes.legend()


@dataclass(frozen=True)
class _View:
    theta_1: float
    title: str


@styled
def picture(params):
    """The linkage closed, half open and stretched, hinges and links on their sphere."""
    views = (_View(1.35, 'nearly closed'), _View(0.9, 'half open'), _View(0.25, 'stretched'))
    sheet = new_figure(9.6, 3.6)
    for k, view in enumerate(views):
        axes = sheet.add_subplot(1, 3, k + 1, projection='3d')
        _draw_linkage(axes, params, view.theta_1)
        axes.set_title(f'{view.title}, tip at {np.degrees(polar_angle(params, view.theta_1)):.0f} '
                       'deg', fontsize=9)
    return Plate(f'{NAME}-linkage', sheet, 'The scissor linkage at three openings.')


def _draw_linkage(axes, params, theta_1):
    psi, bend = passive_angles(params, theta_1, np.zeros(params.links)), np.zeros(params.links)
    lift = np.array([0.0, 0.0, params.radius])
    for side, colour in ((1, OURS), (-1, SERIES[1])):
        frames = branch(params, 0.0, theta_1, psi, bend, side)
        points = np.array([lift] + [frames[2 * k + 3][:3, 3] + lift
                                    for k in range(params.links)])
        for a, b in zip(points[:-1], points[1:], strict=True):
            s = np.linspace(0.0, 1.0, 20)[:, None]
            line = (1 - s) * a + s * b
            axes.plot(*(params.radius * line / np.linalg.norm(line, axis=1)[:, None]).T,
                      color=colour, lw=2.5)
        axes.plot(*points.T, 'o', color=INK, ms=3)
    axes.plot(*tip(params, 0.0, theta_1), 'v', color=GOAL, ms=8)
    axes.plot(0.0, 0.0, 0.0, '+', color=INK)
    axes.set_box_aspect((1, 1, 0.55))
    axes.set(xlim=(-0.05, 0.27), ylim=(-0.16, 0.16), zlim=(0.0, 0.26))
    axes.set_xticklabels([])
    axes.set_yticklabels([])
    axes.set_zticklabels([])
