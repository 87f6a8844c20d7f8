"""The pages: verdict first, self-contained, honest about what is missing."""

import dataclasses
import re
from html.parser import HTMLParser

import pytest

from arm_brachy.evaluation import assess, report, residual_report
from arm_brachy.evaluation.procedure_data import ProcedureData
from arm_brachy.evaluation.timeseries import MoveWindow

VOID = {'meta', 'img', 'br', 'link', 'hr', 'input'}


class Balance(HTMLParser):
    """Collects the text and what a page would fetch; fails on tags that do not nest."""

    def __init__(self):
        super().__init__()
        self.open, self.fetched, self.words = [], [], []

    def handle_starttag(self, tag, attrs):
        self.fetched += [v for k, v in attrs if k in ('src', 'href', 'data')]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def read(path):
    page = Balance()
    page.feed(path.read_text(encoding='utf-8'))
    assert page.open == []
    return page, ' '.join(' '.join(page.words).split())


@pytest.fixture(scope='module')
def page(run, tmp_path_factory):
    out = tmp_path_factory.mktemp('report') / 'report.html'
    assert report.write_report(run, assess.assess(run), out) == out
    return read(out)


def test_report_stands_alone(page):
    fetched = page[0].fetched
    assert len(fetched) == 4   # time response, body, forces, streams
    assert all(uri.startswith('data:image/svg+xml;base64,') for uri in fetched)


def test_verdict_comes_before_the_numbers(page):
    text = page[1]
    verdict = text.index('1 of 4 goals missed: messages lost 121 (required = 0).')
    assert verdict < text.index('Settling time')


def test_report_says_how_to_get_it_again(page, run):
    text = page[1]
    for part in (run.command, 'Seed 7', run.commit, run.machine, 'horizon: 5'):
        assert part in text


def test_report_names_what_the_nodes_said(page):
    assert 'mpc_manipulator STALE_INPUT 1 em/target_1 silent for 60 ms' in page[1]


def test_bare_recording_gets_a_page_without_guesses(run, tmp_path):
    bare = dataclasses.replace(
        run, truth={}, tissue=None, force=None, wall_time=None, outcomes=(), tasks=run.tasks[:1],
        topics=tuple(dataclasses.replace(r, published=None) for r in run.topics),
        scenario='<script>alert(1)</script>')
    out = report.write_report(bare, assess.assess(bare), tmp_path / 'bare.html')
    page, text = read(out)
    assert len(page.fetched) == 2
    assert '1 of 2 goals cannot be judged' in text
    assert 'losses not counted' in text
    assert 'stretch' not in text
    assert '<script>alert' not in out.read_text(encoding='utf-8')


def test_report_of_moves_speaks_of_moves(run, tmp_path):
    windows = (MoveWindow('deep push', 1.0, 4.0, (), True),
               MoveWindow('pair', 4.0, 7.0, (), False, 'pad stands 3.0 mm short'))
    kept = tuple(r for r in run.topics if r.topic != 'optical/frame')
    probed = dataclasses.replace(run, tasks=(), moves=windows, moves_planned=2, topics=kept)
    page, text = read(report.write_report(probed, assess.assess(probed), tmp_path / 'a.html'))
    assert '1 of 2 goals missed: moves made 1 (required = 2). 2 prescribed moves;' in text
    assert 'Deepest push' in text and 'pad stands 3.0 mm short' in text
    assert 'Overshoot' not in text and 'No task' not in text
    assert len(page.fetched) == 4   # pad travel, body, forces, streams


def test_run_that_meets_its_goals_says_so(run, tmp_path):
    kept = tuple(r for r in run.topics if r.topic != 'optical/frame')
    good = dataclasses.replace(run, topics=kept, tasks=run.tasks[:1], tissue=None, force=None)
    text = read(report.write_report(good, assess.assess(good), tmp_path / 'good.html'))[1]
    assert 'All 2 goals met.' in text


def test_a_procedure_that_failed_says_why_in_the_verdict_once(run, tmp_path):
    why = 'registering: choose another hole'
    steps = ((0.0, {'phase': 'registering', 'outcome': 'OK'}),
             (2.0, {'phase': 'finished', 'outcome': 'INFEASIBLE', 'message': why}))
    failed = dataclasses.replace(run, procedure=ProcedureData(
        steps=steps, target='target_1', strategy='orientation', control='impedance'))
    text = read(report.write_report(failed, assess.assess(failed), tmp_path / 'failed.html'))[1]
    assert 'without overlay; 2.0 s. Why it failed: registering: choose another hole.' in text
    assert text.count(why) == 1


def test_residual_report_is_unadorned(replay, tmp_path):
    page, text = read(residual_report.write_residual_report(replay, tmp_path / 'replay.html'))
    assert len(page.fetched) == 3
    assert re.search(r'The model leaves 1\.\d\d mm rms unexplained, 1\d\.\d times', text)
    assert replay.statement in text
    assert 'Rigid registration leaves, rms 0.30 mm' in text


def test_residual_result_has_a_row_per_marker_and_regime(replay):
    result = residual_report.to_result(replay)
    assert len(result.rows) == 6 * 4
    assert result.rows[2]['seen_percent'] == pytest.approx(94.0)
    assert result.targets == ()
