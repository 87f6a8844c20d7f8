"""The page of a recording without tasks or model, such as an import: what it holds, and its gaps.

Test: evaluation/test_stream_figures.py
"""

import numpy as np

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
from arm_brachy.evaluation.result import Result
from arm_brachy.evaluation.stream_figures import shown_streams, streams_plate


def write_stream_report(run, out_html):
    """Write the page of a timeseries.RunData to `out_html`; returns (Result, path)."""
    rows = [_row(*panel) for panel in shown_streams(run)]
    columns = (Column('stream', numeric=False), Column('channels'), Column('rate', 'Hz'),
               Column('start', 's'), Column('stop', 's'), Column('missing', 'values'),
               Column('largest'), Column('of what', numeric=False))
    grid = Grid(columns, tuple(tuple(Cell(_text(value)) for value in row.values())
                               for row in rows),
                'Rate by the median period. Markers and tools: distance from where they were '
                'first seen.')
    lost = sum(row['missing_values'] for row in rows)
    page = write_page(
        'streams.html.j2', out_html, title=f'{run.name}: streams', kind='arm_brachy recording',
        heading=run.name,
        verdict=Verdict('open', 'What was recorded',
                        'The recording has no tasks and no model to be compared with: it can be '
                        'given to arm-brachy diagnose, with its scene.'),
        facts=(Fact('streams', str(len(rows))), Fact('missing values', str(lost))),
        streams=grid, plates=pictures([streams_plate(run)]), provenance=provenance(run),
        command=run.command, scenario='')
    return Result(f'streams of {run.name}', run.seed, run.commit, run.machine, tuple(rows)), page


def _row(title, label, t, names, values):
    what, unit = label.rstrip(']').split(' [')
    period = float(np.median(np.diff(t))) if len(t) > 1 else np.nan
    known = values[np.isfinite(values)]
    return {'stream': title, 'channels': len(names),
            'rate_Hz': round(1.0 / period, 3) if period > 0.0 else 0.0,
            'start_s': round(float(t[0]), 3), 'stop_s': round(float(t[-1]), 3),
            'missing_values': int(np.isnan(values).sum()),
            'largest': round(float(known.max()), 3) if len(known) else None,
            'of': f'{what} in {unit}'}


def _text(value):
    return number(value) if isinstance(value, float) else str('' if value is None else value)
