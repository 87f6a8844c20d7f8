"""The list of terms: look-up, parsing with advice, sorting, documentation."""

import pytest

from arm_brachy import registry
from arm_brachy.core.config import read_yaml
from arm_brachy.core.errors import ConfigError
from arm_brachy.core.quantity import quantities
from arm_brachy.core.term import Kind, Stage
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.viscoelasticity import Viscoelasticity


def test_names_are_unique_and_found():
    names = [term.spec.name for term in registry.TERMS]
    assert len(set(names)) == len(names)
    assert all(registry.by_name(name).spec.name == name for name in names)


def test_entries_become_terms_in_si_and_in_order_of_application():
    terms = registry.parse_terms(
        [{'name': 'backlash', 'width_mm': 0.5},
         {'name': 'viscoelasticity', 'tau1_s': 2.0},
         {'name': 'inclusion', 'radius_mm': 9.0, 'ratio': 4.0}], 'plant.terms')
    assert [t.spec.name for t in terms] == ['inclusion', 'viscoelasticity', 'backlash']
    assert terms[0] == Inclusion(radius=pytest.approx(0.009), ratio=4.0)
    assert terms[1] == Viscoelasticity(tau1=2.0)
    assert terms[2].width == pytest.approx(5e-4)
    assert registry.parse_terms(registry.to_entries(terms), 'again') == terms


def test_two_of_a_kind_keep_their_order():
    entries = [{'name': 'inclusion', 'radius_mm': r} for r in (9.0, 4.0)]
    assert [t.radius for t in registry.parse_terms(entries, 'x')] == pytest.approx([9e-3, 4e-3])


@pytest.mark.parametrize(('entries', 'message'), [
    ([{'name': 'viscoelastic'}],
     "terms\\[0\\]: unknown term 'viscoelastic'; did you"),
    ([{'name': 'zzz'}], f'known: {registry.TERMS[0].spec.name}, '),
    ([{'name': 3}], 'unknown term 3'),
    ([{'radius_mm': 3.0}], 'must be a mapping with a name'),
    (['inclusion'], 'must be a mapping with a name'),
    ([{'name': 'inclusion', 'radius': 3.0}],
     "'radius'; did you mean 'radius_mm'"),
    ([{'name': 'inclusion', 'ratio': -1.0}], 'ratio = -1.0'),
    ([{'name': 'inclusion', 'ratio': 'hard'}], "ratio = 'hard'; must be a number"),
    ([{'name': 'viscoelasticity', 'g1': 0.8, 'g2': 0.7}],
     'terms\\[0\\] viscoelasticity: g1 \\+ g2'),
])
def test_bad_entries_are_refused_in_one_line(entries, message):
    with pytest.raises(ConfigError, match=message) as caught:
        registry.parse_terms(entries, 'terms')
    assert '\n' not in str(caught.value)


def test_the_line_of_the_file_is_named(tmp_path):
    file = tmp_path / 'plant.yaml'
    file.write_text('terms:\n  - name: stiffness_scale\n    factor: 1.1\n'
                    '  - name: inclusion\n    ratio: 900.0\n')
    with pytest.raises(ConfigError, match=r'terms\[1\] inclusion:5: ratio = 900'):
        registry.parse_terms(read_yaml(file)['terms'], 'terms')


def test_entries_are_left_as_they_were():
    entries = [{'name': 'inclusion', 'ratio': 2.0}]
    registry.parse_terms(entries, 'terms')
    assert entries == [{'name': 'inclusion', 'ratio': 2.0}]


def test_split_gives_every_stage_its_terms():
    terms = registry.parse_terms([{'name': t.spec.name} for t in registry.TERMS], 'all')
    parts = registry.split(terms)
    assert set(parts) == set(Stage)
    assert sum(map(len, parts.values())) == len(terms)
    assert [type(t) for t in parts[Stage.BODY]] == [
        c for c in registry.TERMS if c.spec.kind in (Kind.TISSUE, Kind.BOUNDARY)]
    assert registry.split(())[Stage.EM] == ()


@pytest.mark.parametrize(('first', 'then'), [
    ('reference_shape', 'inclusion'),         # a place is one in the true shape
    ('viscoelasticity', 'stress_softening'),  # remembered stress softens and drifts along
    ('viscoelasticity', 'stiffness_drift'),
    ('skin_layer', 'base_compliance'),        # a base that is no longer fixed has a skin
    ('skin_layer', 'base_debond'),
    ('obstacle', 'base_debond'),              # and no wall is met where it lifts off
    ('base_debond', 'base_compliance'),       # what is left of the glue yields
    ('pad_misplacement', 'reference_shape'),  # the mesh slides in the scene's shape
    ('pad_misplacement', 'inclusion'),        # elements are weighed where they come to lie
])
def test_terms_act_in_an_order_that_makes_sense(first, then):
    names = [term.spec.name for term in registry.TERMS]
    assert names.index(first) < names.index(then)


def test_documentation_names_every_term_and_parameter():
    table = registry.documentation_table()
    rows = table.strip().split('\n')
    assert len(rows) == 2 + len(registry.TERMS)
    columns = {row.replace('\\|', '').count('|') for row in rows}
    assert len(columns) == 1
    for term in registry.TERMS:
        row = next(r for r in rows if r.startswith(f'| `{term.spec.name}`'))
        for name, info in quantities(term).items():
            assert f'`{info.key(name)}`' in row
