"""The page: verdict first, stands alone, shows what was found and no more."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from arm_brachy.core.errors import InputError
from arm_brachy.diagnosis.report import figures
from arm_brachy.diagnosis.report.figures import Trace
from arm_brachy.diagnosis.report.page import Shown, write_diagnosis
from arm_brachy.diagnosis.results.cause import Cause, Estimate
from arm_brachy.diagnosis.results.parts import Interval, Place

VOID = {'meta', 'img', 'br', 'link', 'hr'}
CAPTION = re.compile(r'Figure \d\. ')


class Page(HTMLParser):
    """Collects text and what a page would fetch; fails on tags that do not nest."""

    def __init__(self, path):
        super().__init__()
        self.open, self.fetched, self.parts, self.headings = [], [], [], []
        self.feed(path.read_text(encoding='utf-8'))
        assert self.open == []
        self.text = ' '.join(' '.join(self.parts).split())

    def handle_starttag(self, tag, attrs):
        self.fetched += [v for k, v in attrs if k in ('src', 'href', 'data')]
        assert tag != 'script'
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == 'h2':
            self.headings.append(data)
        self.parts.append(data.replace('\N{NO-BREAK SPACE}', ' ').replace('\N{MINUS SIGN}', '-'))


def bare(shown):
    """Without the residuals over time, which take the longest to draw."""
    return replace(shown, traces=())


@pytest.fixture(scope='module')
def pages(answers, shown, tmp_path_factory):
    folder = tmp_path_factory.mktemp('pages')
    return {name: Page(write_diagnosis(d, shown(d), folder / f'{name}.html'))
            for name, d in answers.items()}


@pytest.mark.parametrize('name', ['named', 'structural', 'equivalent', 'nothing_missing',
                                  'unexplained'])
def test_the_verdict_is_read_first_and_the_page_stands_alone(pages, answers, name):
    page = pages[name]
    verdict = page.text.index(answers[name].sentence)
    for later in ('Figure 1.', 'How to get this again'):
        assert verdict < page.text.index(later, verdict)
    assert page.fetched and all(u.startswith('data:image/svg+xml;base64,') for u in page.fetched)
    assert len(CAPTION.findall(page.text)) == len(page.fetched)


def test_the_physics_has_its_equation_symbols_and_source(pages):
    text = pages['structural'].text
    assert 'y(t) = min(max(y(t-), u(t) - (1 - a) w), u(t) + a w)' in text
    assert 'Symbols: u motor position, y pad position, w width [m], a start.' in text
    assert 'Source: play operator: Visintin 1994' in text
    assert '(actuator pad_1)' in text   # not its index


def test_parameters_have_value_interval_and_unit(pages):
    assert 'width lost motion at a reversal 0.310 0.290 to 0.330 mm' in pages['structural'].text
    assert ('centre of the sphere at rest, world frame (18.2, 8.1, 28.4) '
            '(16.0 to 20.4, 6.2 to 10.0, 25.9 to 30.9) mm') in pages['named'].text
    assert "E Young's modulus at small strain 6.31 6.18 to 6.44 kPa" in pages['named'].text


def test_what_was_ruled_out_has_its_score_and_reason(pages):
    text = pages['named'].text
    assert ('inclusion 212.7 named stiffness gradient 31.4 predicts what was held out less '
            'well') in text
    assert 'pad slip 0.0 not ruled out' in text


def test_options_stand_beside_each_other_with_what_decides(pages, answers):
    text = pages['equivalent'].text
    assert 'Option 1, probability 57 %' in text and 'Option 2, probability 43 %' in text
    assert 'To decide it: Record the pad forces as well.' in text
    assert 'speed_mm_s: 20.0' in text and 'position_mm: 8.0' in text


def test_findings_and_notes_are_below(pages):
    text = pages['structural'].text
    assert text.index('How well it fits') < text.index('departs from the encoder by 0.31 mm')
    assert 'optical has 200 samples a second in all; they were' in pages['named'].text


def test_nothing_missing_claims_no_place_and_no_cause(pages):
    page = pages['nothing_missing']
    assert len(page.fetched) == 2   # over time and how well; no body
    assert {'Where', 'What', 'The corrected scene'} <= set(pages['named'].headings)
    assert not {'Where', 'When', 'What', 'The corrected scene'} & set(page.headings)


def test_what_would_have_shown_has_its_size_and_unit(pages):
    page = pages['nothing_missing']
    assert 'What these recordings would have shown' in page.headings
    assert 'backlash width 0.043 mm 14 inclusion ratio 2.7 85' in page.text
    assert 'What these recordings would have shown' not in pages['named'].headings


def test_a_scene_with_nothing_but_a_modulus_says_so(answers, shown, tmp_path):
    sound = replace(answers['nothing_missing'], scene='corrected.yaml')
    page = Page(write_diagnosis(sound, bare(shown(sound)), tmp_path / 'page.html'))
    assert 'Has what was recalibrated, for nothing was found' in page.text
    assert 'Shows what was found' not in page.text


def test_how_to_get_it_again(pages, answers):
    source = answers['named'].provenance
    for part in (source.command, str(source.seed), source.commit, source.machine):
        assert part in pages['named'].text


def test_markup_in_names_stays_text(answers, shown, tmp_path):
    d = answers['named']
    odd = replace(d, notes=('<script>alert(1)</script>',),
                  provenance=replace(d.provenance, name='<b>x'))
    assert '<script>' not in write_diagnosis(odd, bare(shown(d)), tmp_path / 'x.html').read_text()


def test_a_page_without_traces_and_fits_is_a_page(answers, shown, tmp_path):
    d = replace(answers['structural'], fit=(), findings=(), when=())
    page = Page(write_diagnosis(d, bare(shown(d)), tmp_path / 'x.html'))
    assert len(page.fetched) == 1 and d.sentence in page.text


def test_a_parameter_without_interval_says_so(answers, shown, tmp_path):
    d = replace(answers['named'], causes=(Cause('pad_misplacement', {
        'tilt_side': Estimate(0.03, -np.inf, np.inf)}, {'pads': ('pad_1',)}),))
    assert 'not known deg' in Page(write_diagnosis(d, bare(shown(d)), tmp_path / 'x.html')).text


def test_places_are_drawn_at_their_true_size(shown, answers):
    d = answers['named']
    plate = figures.where_plate(d, shown(d).body)
    above, side = plate.figure.axes
    for axis, centre in ((above, (18.2, 8.1)), (side, (18.2, 28.4))):
        [circle] = axis.patches
        assert circle.center == pytest.approx(centre) and circle.radius == pytest.approx(3.1)
        assert axis.get_xlabel().endswith('/ mm') and axis.get_ylabel().endswith('/ mm')


def test_a_stream_as_a_whole_has_no_picture(shown, answers):
    d = replace(answers['structural'], where=(Place(stream='optical'),))
    assert figures.where_plate(d, shown(d).body) is None


def test_the_pad_over_a_place_is_pointed_out(shown, answers):
    d = replace(answers['named'], where=(Place(boundary='surface under pad_1', term='pad_slip'),))
    plate = figures.where_plate(d, shown(d).body)
    weights = {text.get_text(): text.get_fontweight() for text in plate.figure.axes[0].texts}
    assert [name for name, weight in weights.items() if weight == 'bold'] == ['pad_1']
    assert plate.caption.endswith('In orange: pad_1.')


def test_intervals_are_shaded_where_they_are(shown, answers):
    d = answers['unexplained']
    plate = figures.when_plate(d, shown(d).traces)
    for axis in plate.figure.axes:
        [span] = axis.patches
        assert (span.get_x(), span.get_width()) == pytest.approx((23.4, 3.8))
        assert '/ mm' in axis.get_ylabel() or '/ N' in axis.get_ylabel()


def test_the_noise_floor_is_drawn_in_the_unit_of_the_stream(shown, answers):
    d = answers['unexplained']
    optical, _, force = figures.when_plate(d, shown(d).traces).figure.axes
    heights = [[line.get_ydata()[0] for line in axis.get_lines() if line.get_label() ==
                'noise alone'] for axis in (optical, force)]
    assert heights == [[pytest.approx(0.15)], [pytest.approx(0.03)]]


def test_recordings_in_which_something_shows_come_first(answers):
    t = np.linspace(0.0, 1.0, 5)
    traces = [Trace(f'run_{i}', 'optical', t, t * 1e-3, 1e-4) for i in range(5)]
    d = replace(answers['unexplained'], when=(Interval('run_4', 0.2, 0.4),))
    plate = figures.when_plate(d, traces)
    assert [axis.get_title() for axis in plate.figure.axes] == ['run_4', 'run_0', 'run_1']
    assert '2 more recordings not drawn' in plate.caption


def test_what_goes_on_at_the_same_time_is_named_on_lines_of_its_own(answers):
    t = np.linspace(0.0, 40.0, 200)
    when = [Interval('run', a, b, term=term) for a, b, term in (
        (0.0, 40.0, 'actuator_compliance'), (1.0, 18.0, 'strain_stiffening'),
        (24.0, 30.0, 'strain_stiffening'))]
    plate = figures.when_plate(replace(answers['unexplained'], when=tuple(when)),
                               [Trace('run', 'optical', t, 1e-4 + 1e-5 * np.sin(t), 1e-4)])
    plate.figure.canvas.draw()
    first, second = plate.figure.axes[0].texts
    assert not first.get_window_extent().overlaps(second.get_window_extent())


def test_bars_are_the_errors(answers):
    axis = figures.fit_plate(answers['named']).figure.axes[0]
    assert [bar.get_width() for bar in axis.patches] == pytest.approx([0.62, 0.41, 0.16])


def test_a_trace_must_be_as_long_as_its_time():
    with pytest.raises(InputError, match=r'shape \(3,\)'):
        Trace('run', 'optical', np.arange(4.0), np.zeros(3), 1e-4)


def test_a_hundred_recordings_stay_a_page(answers, shown, tmp_path):
    d = replace(answers['unexplained'], when=tuple(
        Interval(f'run_{i}', 1.0, 2.0) for i in range(100)))
    page = Page(write_diagnosis(d, bare(shown(d)), tmp_path / 'x.html'))
    assert 'of run_0.' in page.text and 'run_99' not in page.text
    assert 'And 94 more.' in page.text


def test_shown_carries_no_traces_unless_given(shown, answers):
    assert Shown(shown(answers['named']).body).traces == ()


@pytest.mark.parametrize('field', ['pad', 'carrier'])
@pytest.mark.parametrize('pad, told', [(1, True), (-1, False)])
def test_metal_on_a_pad_is_told_by_its_name(answers, shown, tmp_path, field, pad, told):
    d = replace(answers['named'], where=(), when=(), causes=(Cause(
        'em_distortion', {'pad_coupling': Estimate((0.1, 0.0, 0.0), (0.08, 0.0, 0.0),
                                                   (0.12, 0.0, 0.0))}, {field: pad}, 0.99),))
    page = Page(write_diagnosis(d, bare(shown(d)), tmp_path / 'page.html'))
    assert ('(pad pad_2)' in page.text) == told
    assert '-1' not in page.text
