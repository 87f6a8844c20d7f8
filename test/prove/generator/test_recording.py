"""A whole case: files, names, seeds, and that nothing hidden is in the folder."""
import gzip
import json
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.prove.generator.case import TERMS, draw
from arm_brachy.prove.generator.form import REGISTRY
from arm_brachy.prove.generator.make import make
from arm_brachy.prove.generator.strange import STRANGE

FILES = ['body.json', 'em.csv.gz', 'encoders.csv.gz', 'forces.csv.gz', 'optical.csv.gz']


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def table(folder, stream):
    """Names of the columns, and the rows, of one stream."""
    text = gzip.decompress((folder / f'{stream}.csv.gz').read_bytes()).decode()
    head, *rows = text.splitlines()
    return head.split(','), np.array([[float(v) if v else np.nan for v in r.split(',')]
                                      for r in rows])


@pytest.fixture(scope='module')
def case(body):
    drawn = draw(np.random.default_rng(1), 'marker_slip', body)
    return replace(drawn, effects=tuple(replace(e, form=REGISTRY) for e in drawn.effects))


@pytest.fixture(scope='module')
def made(case, cache, tmp_path_factory):
    folder = tmp_path_factory.mktemp('case')
    return folder, make(case, folder, cache)


def test_same_case_gives_the_same_bits(made, case, cache, tmp_path):
    folder, _ = made
    make(case, tmp_path, cache)
    assert contents(tmp_path) == contents(folder)


def test_a_null_recording_has_the_same_body_and_set_up_but_other_noise(made, case, cache,
                                                                       tmp_path):
    folder, truth = made
    null = make(case.without_effect, tmp_path, cache)
    assert null['labels'] == [] and null['nuisances'] == truth['nuisances']
    assert contents(tmp_path)['body.json'] == contents(folder)['body.json']
    _, one = table(folder, 'forces')
    _, two = table(tmp_path, 'forces')
    n = min(len(one), len(two))
    assert 0.005 < np.std(one[:n, 1:] - two[:n, 1:]) < 0.03


def test_files_name_what_the_body_has_and_tell_nothing_else(made, body):
    folder, truth = made
    assert sorted(p.name for p in folder.iterdir()) == FILES
    known = json.loads((folder / 'body.json').read_text())
    head, rows = table(folder, 'optical')
    assert head[0] == 't_s'
    assert {name.rsplit('_', 2)[0] for name in head[1:]} == set(known['markers_m'])
    assert table(folder, 'encoders')[0][1:] == [f'q_{p.name}_m' for p in body.pads]
    assert table(folder, 'forces')[0][1] == f'f_{body.pads[0].name}_x_N'
    assert 0.0005 < np.isnan(rows).mean() < 0.1
    text = (folder / 'body.json').read_text()
    hidden = {*TERMS, *STRANGE, 'solver', 'seed'} - {'gravity'}
    assert not [name for name in hidden if name in text]
    assert 'marker_slip' == truth['labels'][0]


def test_the_slip_is_in_the_recording_at_its_marker_and_time(made, case, cache, tmp_path):
    folder, truth = made
    make(replace(case, effects=()), tmp_path, cache)
    effect = truth['effects'][0]
    head, with_slip = table(folder, 'optical')
    _, without = table(tmp_path, 'optical')
    column = head.index(effect['values']['marker_name'] + '_x_m')
    late = with_slip[:, 0] > effect['onset_s'] + 0.01
    off = (with_slip - without)[:, column:column + 3]
    np.testing.assert_allclose(np.nanmean(off[late], 0) * 1e3, effect['values']['offset_mm'],
                               rtol=0.02, atol=0.02)
    assert np.nanmax(np.abs(off[with_slip[:, 0] < effect['onset_s'] - 0.01])) < 1e-6


def test_surface_is_closed_and_outward(made):
    known = json.loads((made[0] / 'body.json').read_text())
    x = np.array(known['surface']['vertices_m'])
    tri = np.array(known['surface']['triangles'])
    edges = {tuple(e) for t in tri.tolist() for e in zip(t, t[1:] + t[:1], strict=True)}
    assert all((b, a) in edges for a, b in edges)
    a, b, c = (x[tri[:, i]] for i in range(3))
    assert np.einsum('ij,ij->', a, np.cross(b, c)) / 6 > 1e-4


def test_an_unknown_kind_is_refused(body):
    with pytest.raises(ValueError, match='nonsense'):
        draw(np.random.default_rng(0), 'nonsense', body)


def test_every_term_and_family_can_be_drawn_with_plain_values(body):
    for name in (*TERMS, *STRANGE):
        case = draw(np.random.default_rng(4), name, body)
        assert [e.name for e in case.effects] == [name]
        assert 0.2 <= case.effects[0].size <= 2
        json.dumps(case.effects[0].values)


def test_pairs_are_two_different_terms(body):
    case = draw(np.random.default_rng(4), 'pair', body)
    assert len({e.name for e in case.effects}) == 2
