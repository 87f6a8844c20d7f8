"""Discretisation error of the truth: one pad on meshes ever finer, and effects on two meshes.

`python -m arm_brachy.prove.generator.convergence` prints the table (some minutes).
"""
import time
from dataclasses import replace

import numpy as np

from arm_brachy.prove.generator.body import COARSE, draw_body
from arm_brachy.prove.generator.catalogue import draw_effect
from arm_brachy.prove.generator.probe import locate
from arm_brachy.prove.generator.response import outputs, solve_response
from arm_brachy.prove.generator.tissue import STATIC, TIMED

SIZES = (1.3, 1.0, 0.62, 0.45, 0.33)
FINE = {'size': 0.5, 'pressure': 'nodal', 'turn': 0.8, 'levels': 3}


def solve(body, size, pressure, share=1.0, turn=0.3):
    """Displacements of the probes (k, 3) [m], forces (p, 3) [N], unknowns, seconds; pad 0."""
    begin = time.process_time()
    grid = body.grid({'size': size, 'pressure': pressure, 'turn': turn})
    model = body.model(grid)
    y = np.zeros(len(body.pads))
    y[0] = share * body.pads[0].stroke
    state = model.follow(model.rest(), y)
    out = outputs(model, locate(body.points, grid.nodes, grid.mesh.tets), state)
    cut = 3 * len(body.pads)
    return (out[:-cut].reshape(-1, 3), out[-cut:].reshape(-1, 3), grid.pattern.n,
            time.process_time() - begin)


def study(body, sizes=SIZES, pressures=('nodal', 'cell'), share=1.0):
    """Rows: pressure, size, unknowns, largest error of a marker [mm], of the force [%], CPU [s].

    Errors are against nodal pressures on the finest mesh, whose row of itself is left out.
    """
    moved, force, _, _ = solve(body, sizes[-1], 'nodal', share)
    rows = []
    for pressure in pressures:
        for size in sizes[:-1]:
            u, f, unknowns, seconds = solve(body, size, pressure, share)
            off = 1e3 * np.linalg.norm(u - moved, axis=1).max()
            percent = 100 * np.linalg.norm(f[0] - force[0]) / np.linalg.norm(force[0])
            rows.append((pressure, size, unknowns, off, percent, seconds))
    return rows


def effect_of(body, effect, options):
    """Change of the outputs (l, o) of pad 0 alone by a static or timed effect, on one mesh."""
    grid = body.grid(options)
    probes = locate(body.points, grid.nodes, grid.mesh.tets)
    plain, states = solve_response(body.model(grid), probes, ())
    make = STATIC.get(effect.name) or (lambda *a: TIMED[effect.name](*a)[0])
    model = make(body.model(grid), body, effect.values, 1.0)
    mesh = model.grid.mesh
    planted, _ = solve_response(model, locate(body.points, mesh.nodes, mesh.tets), (),
                                guess=states)
    return (planted.alone - plain.alone)[0]


def study_effects(body, seed=0, fine=FINE):
    """Rows: effect, what it moves [mm] and by how much the coarse mesh errs in that [%], and
    the same of forces [N]; root mean squares over all outputs and levels of travel.
    """
    for name in (*STATIC, *TIMED):
        effect = draw_effect(np.random.default_rng(seed), name, body)
        right, coarse = (effect_of(body, effect, o) for o in (fine, COARSE))
        cut = 3 * len(body.pads)
        size = [np.sqrt((x**2).mean()) for x in (right[:, :-cut], right[:, -cut:])]
        error = [np.sqrt((x**2).mean()) for x in ((coarse - right)[:, :-cut],
                                                  (coarse - right)[:, -cut:])]
        yield (name, effect.size, 1e3 * size[0], 100 * error[0] / size[0], size[1],
               100 * error[1] / size[1])


def main():
    """Print the studies of one random body with one pad at its full stroke."""
    body = draw_body(np.random.default_rng(2), 'study')
    body = replace(body, pads=body.pads[:1])
    print('pressure  size/radius  unknowns  marker error [mm]  force error [%]  CPU [s]')
    for pressure, size, unknowns, off, percent, seconds in study(body):
        print(f'{pressure:8}  {size:11.2f}  {unknowns:8d}  {off:17.4f}  {percent:15.2f}'
              f'  {seconds:7.1f}')
    print('effect                size  markers [mm]  error [%]  force [N]  error [%]')
    for name, size, moved, moved_error, force, force_error in study_effects(body):
        print(f'{name:20}  {size:4.2f}  {moved:12.4f}  {moved_error:9.1f}  {force:9.4f}'
              f'  {force_error:9.1f}', flush=True)


if __name__ == '__main__':
    main()
