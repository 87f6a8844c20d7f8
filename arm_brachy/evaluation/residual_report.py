"""The report of an offline replay: what the model leaves unexplained of a recording, unadorned."""

import numpy as np

from arm_brachy.evaluation import body_view, regimes, residual_figures, residuals, vibration
from arm_brachy.evaluation.page import (
    Cell,
    Column,
    Fact,
    Grid,
    Verdict,
    number,
    pictures,
    provenance,
    write_page,
)
from arm_brachy.evaluation.residual_figures import WORDS
from arm_brachy.evaluation.result import Result


def write_residual_report(data, out_html):
    """Write the report of a replay (timeseries.ResidualData) to `out_html`; Returns the path."""
    r = residuals.residual(data.measured, data.predicted)
    floor = floor_of(data)
    rows = residuals.marker_residuals(data, floor)
    whole = [row for row in rows if row.regime == 'all']
    return write_page(
        'residual.html.j2', out_html, title=f'{data.name}: replay',
        kind='arm_brachy replay report', heading=data.name, verdict=_verdict(data, r, floor),
        carrier=WORDS[data.kind].carrier, facts=_facts(data, r, floor, whole),
        markers=_marker_grid(data, whole, floor), regimes=_regime_grid(data, rows),
        vibration=vibration.grid(vibration.compare(data, floor)),
        plates=pictures(plates(data, r, floor)), departures=_departure_grid(data),
        provenance=provenance(data), command=data.command, scenario=data.scenario)


def plates(data, r, floor):
    """The figures of the report, as style.Plate in order; no body if nothing was seen."""
    drawn = [residual_figures.residual_norms(data, r, floor),
             residual_figures.residual_axes(data, r)]
    total = np.nansum(r ** 2, axis=(1, 2))
    if data.kind == 'position' and total.any():
        drawn.insert(1, body_view.residual_body(data, r, int(total.argmax())))
    return drawn


def floor_of(data):
    """The noise floor (k,) [m or N]: as stated in `data`, else from the recording's idle frames.

    Without an idle second the whole recording is used.
    """
    if data.noise_floor is not None:
        return np.asarray(data.noise_floor)
    idle = regimes.inside(data.t, data.regimes, regimes.IDLE)
    long_enough = idle.any() and idle.sum() * np.median(np.diff(data.t)) >= 1.0
    return residuals.noise_floor(data.measured, idle if long_enough else None)


def to_result(data):
    """Residual per marker (or pad) and regime in the common JSON form.

    Units are in the keys: mm for positions, N for forces. No goal is set, so no targets. Where a
    body was let go, its free vibration follows, measured beside predicted.
    """
    floor = floor_of(data)
    noise = dict(zip(data.names, floor, strict=True))
    rows = [_row(data, row, noise[row.marker]) for row in residuals.marker_residuals(data, floor)]
    rows += [pair.row() for pair in vibration.compare(data, floor)]
    return Result(data.name, data.seed, data.commit, data.machine, tuple(rows))


def _row(data, row, noise):
    words = WORDS[data.kind]
    unit, scale = words.unit, words.scale
    axes = {f'{what}_{axis}_{unit}': values[i] * scale
            for what, values in (('rms', row.rms_axes), ('bias', row.bias))
            for i, axis in enumerate('xyz')}
    return {words.carrier: row.marker, 'regime': row.regime, f'rms_{unit}': row.rms * scale,
            f'largest_{unit}': row.largest * scale, **axes, 'gain': row.gain,
            f'noise_floor_rms_{unit}': noise * scale, 'seen_percent': row.seen * 100}


def _verdict(data, r, floor):
    words = WORDS[data.kind]
    rms, noise = residuals.pooled_rms(r), _pooled(floor)
    ratio = rms / noise if noise > 0 else np.nan
    line = (f'The model leaves {number(rms * words.scale)} {words.unit} rms unexplained, '
            f'{number(ratio, 1)} times the noise floor of {number(noise * words.scale, 3)} '
            f'{words.unit}.')
    return Verdict('open', line, data.statement)


def _pooled(values):
    known = np.asarray(values)[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(known)))) if len(known) else np.nan


def _facts(data, r, floor, whole):
    words = WORDS[data.kind]
    unit, scale = words.unit, words.scale
    seen = [row for row in whole if np.isfinite(row.rms)]
    facts = [Fact(f'Residual, all {words.plural}, rms',
                  number(residuals.pooled_rms(r) * scale), unit)]
    if seen:
        worst = max(seen, key=lambda row: row.rms)
        facts.append(Fact(f'Worst {words.carrier}: {worst.marker}, rms',
                          number(worst.rms * scale), unit))
    facts.append(Fact('Noise floor, rms', number(_pooled(floor) * scale, 3), unit))
    if data.registration is not None:
        facts.append(Fact('Rigid registration leaves, rms',
                          number(_pooled(data.registration) * scale), unit))
    facts.append(Fact(f'Recording, {len(data.names)} {words.plural}',
                      number(data.t[-1] - data.t[0], 1), f's, {len(data.t)} frames'))
    return facts


def _marker_grid(data, whole, floor):
    words = WORDS[data.kind]
    unit, scale = words.unit, words.scale
    registration = data.registration
    if registration is None:
        registration = np.full(len(data.names), np.nan)
    rows = tuple(
        tuple(Cell(text) for text in (
            row.marker, number(row.rms * scale), number(row.largest * scale),
            *(number(v * scale) for v in (*row.rms_axes, *row.bias)), number(row.gain),
            number(noise * scale, 3), number(row.rms / noise if noise > 0 else np.nan, 1),
            number(left * scale), number(row.seen * 100, 1)))
        for row, noise, left in zip(whole, floor, registration, strict=True))
    columns = (
        Column(words.carrier.capitalize(), numeric=False), Column('Residual, rms', unit),
        Column('Largest', unit), *(Column(f'Rms {a}', unit) for a in 'xyz'),
        *(Column(f'Bias {a}', unit) for a in 'xyz'), Column('Gain', 'measured / model'),
        Column('Noise floor, rms', unit), Column('Rms / floor', '1'),
        Column('Registration residual', unit), Column('Seen', '% of frames'))
    if data.registration is None:
        keep = [i for i, c in enumerate(columns) if c.title != 'Registration residual']
        columns = tuple(columns[i] for i in keep)
        rows = tuple(tuple(row[i] for i in keep) for row in rows)
    return Grid(columns, rows, _marker_note(data))


def _marker_note(data):
    origin = ('as stated for the instrument' if data.noise_floor is not None else
              'from second differences of the idle stretches: white noise only, no drift')
    note = (f'Residual: measured minus predicted. Bias: its mean. Gain: measured over predicted '
            f'motion, least squares about either mean; a dash where the model hardly moves. '
            f'Noise floor: rms of the norm that a perfect model would leave, {origin}.')
    if data.registration is not None:
        note += (' Registration residual: what a rigid fit between laboratory and model frame '
                 'leaves at rest; geometry and markers are known no better than that.')
    return note + ' Nothing of this is subtracted from the residual.'


def _departure_grid(data):
    return Grid((Column('Found', 's'), Column('Departure from the model', numeric=False)), tuple(
        (Cell(number(t)), Cell(said)) for t, said in data.departures), (
        'By the mismatch monitor, which ran beside the model: cumulative sums of whitened '
        'residuals per channel and axis. A sensor of one axis is compared along it alone.'))


def _regime_grid(data, rows):
    words = WORDS[data.kind]
    names = list(dict.fromkeys(row.regime for row in rows if row.regime != 'all'))
    by_cell = {(row.marker, row.regime): row for row in rows}
    columns = (Column(words.carrier.capitalize(), numeric=False),
               *(Column(f'{name}: {what}', words.unit) for name in names
                 for what in ('rms', 'bias')))
    cells = tuple(
        (Cell(marker), *(Cell(number(value * words.scale)) for name in names
                         for value in (by_cell[marker, name].rms,
                                       np.linalg.norm(by_cell[marker, name].bias))))
        for marker in data.names)
    return Grid(columns, cells if names else (), (
        'Regimes as shaded in the figures; bias is the length of the mean residual. A residual '
        'that stays at rest points at geometry or registration, one that grows with load at '
        'stiffness, one that rings at mass, stiffness or damping.'))
