"""The report of an offline replay: what the model leaves unexplained of a recording, unadorned."""

import numpy as np

from arm_brachy.evaluation import body_view, residual_figures, residuals
from arm_brachy.evaluation.page import (Cell, Column, Fact, Grid, Verdict, number, pictures,
                                        provenance, write_page)
from arm_brachy.evaluation.result import Result

MM = 1e3

MARKER_COLUMNS = (
    Column('Marker', numeric=False), Column('Residual, rms', 'mm'), Column('Largest', 'mm'),
    Column('Bias x', 'mm'), Column('Bias y', 'mm'), Column('Bias z', 'mm'),
    Column('Noise floor, rms', 'mm'), Column('Rms / floor', '1'),
    Column('Registration residual', 'mm'), Column('Seen', '% of frames'))


def write_residual_report(data, out_html):
    """Write the report of a replay (timeseries.ResidualData) to `out_html`; Returns the path."""
    r = residuals.residual(data.measured, data.predicted)
    floor = floor_of(data)
    rows = residuals.marker_residuals(data)
    whole = [row for row in rows if row.regime == 'all']
    return write_page(
        'residual.html.j2', out_html, title=f'{data.name}: replay',
        kind='arm_brachy replay report', heading=data.name, verdict=_verdict(data, r, floor),
        facts=_facts(data, r, floor, whole), markers=_marker_grid(data, whole, floor),
        regimes=_regime_grid(data, rows), plates=pictures(plates(data, r, floor)),
        provenance=provenance(data), command=data.command, scenario=data.scenario)


def plates(data, r, floor):
    """The figures of the report, as style.Plate in order; no body if nothing was seen."""
    drawn = [residual_figures.residual_norms(data, r, floor),
             residual_figures.residual_axes(data, r)]
    total = np.nansum(r ** 2, axis=(1, 2))
    if total.any():
        drawn.insert(1, body_view.residual_body(data, r, int(total.argmax())))
    return drawn


def floor_of(data):
    """The noise floor (k,) [m]: as stated in `data`, else estimated from the recording."""
    if data.noise_floor is not None:
        return np.asarray(data.noise_floor)
    return residuals.noise_floor(data.measured)


def to_result(data):
    """Residual per marker and regime in the common JSON form; no goal is set, so no targets."""
    floor = dict(zip(data.names, floor_of(data), strict=True))
    rows = tuple({'marker': row.marker, 'regime': row.regime, 'rms_mm': row.rms * MM,
                  'largest_mm': row.largest * MM, 'bias_x_mm': row.bias[0] * MM,
                  'bias_y_mm': row.bias[1] * MM, 'bias_z_mm': row.bias[2] * MM,
                  'noise_floor_rms_mm': floor[row.marker] * MM, 'seen_percent': row.seen * 100}
                 for row in residuals.marker_residuals(data))
    return Result(data.name, data.seed, data.commit, data.machine, rows)


def _verdict(data, r, floor):
    rms, noise = residuals.pooled_rms(r), _pooled(floor)
    ratio = rms / noise if noise > 0 else np.nan
    line = (f'The model leaves {number(rms * MM)} mm rms unexplained, {number(ratio, 1)} times '
            f'the noise floor of {number(noise * MM, 3)} mm.')
    return Verdict('open', line, data.statement)


def _pooled(values):
    return float(np.sqrt(np.nanmean(np.square(values))))


def _facts(data, r, floor, whole):
    seen = [row for row in whole if np.isfinite(row.rms)]
    facts = [Fact('Residual, all markers, rms', number(residuals.pooled_rms(r) * MM), 'mm')]
    if seen:
        worst = max(seen, key=lambda row: row.rms)
        facts.append(Fact(f'Worst marker: {worst.marker}, rms', number(worst.rms * MM), 'mm'))
    facts.append(Fact('Noise floor, rms', number(_pooled(floor) * MM, 3), 'mm'))
    if data.registration is not None:
        facts.append(Fact('Rigid registration leaves, rms',
                          number(_pooled(data.registration) * MM), 'mm'))
    facts.append(Fact(f'Recording, {len(data.names)} markers', number(data.t[-1] - data.t[0], 1),
                      f's, {len(data.t)} frames'))
    return facts


def _marker_grid(data, whole, floor):
    registration = data.registration
    if registration is None:
        registration = np.full(len(data.names), np.nan)
    rows = tuple(
        tuple(Cell(text) for text in (
            row.marker, number(row.rms * MM), number(row.largest * MM),
            *(number(b * MM) for b in row.bias), number(noise * MM, 3),
            number(row.rms / noise if noise > 0 else np.nan, 1), number(left * MM),
            number(row.seen * 100, 1)))
        for row, noise, left in zip(whole, floor, registration, strict=True))
    origin = ('as stated for the instrument' if data.noise_floor is not None else
              'estimated from second differences of the recording: white noise only, no drift')
    note = (f'Residual: measured minus predicted position. Bias: its mean. Noise floor: rms of '
            f'the norm that a perfect model would leave, {origin}. Registration residual: what a '
            f'rigid fit between laboratory and model frame leaves at rest; geometry and markers '
            f'are known no better than that. Nothing of either is subtracted from the residual.')
    return Grid(MARKER_COLUMNS, rows, note)


def _regime_grid(data, rows):
    regimes = list(dict.fromkeys(row.regime for row in rows if row.regime != 'all'))
    by_cell = {(row.marker, row.regime): row.rms for row in rows}
    columns = (Column('Marker', numeric=False), *(Column(name, 'mm rms') for name in regimes))
    cells = tuple((Cell(marker), *(Cell(number(by_cell[marker, name] * MM)) for name in regimes))
                  for marker in data.names)
    return Grid(columns, cells if regimes else (), (
        'Regimes as marked in the figures. A residual that stays in rest points at geometry or '
        'registration, one that grows with load at stiffness, one that rings at mass or damping.'))
