"""From what size on a cause would have shown, by recordings in which it is as large as that."""

from types import SimpleNamespace

import numpy as np
import pytest

from arm_brachy.core.config import to_mapping
from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.selection.detectability import FAR, SHOWS, limits_of
from arm_brachy.diagnosis.selection.problem import assemble
from arm_brachy.diagnosis.selection.screening import Tried
from arm_brachy.diagnosis.statistics.linear_gaussian import detectability
from arm_brachy.registry import by_name


def assembled(matched, hypotheses):
    return assemble((matched,), Tried(tuple(hypotheses), tuple(
        (respond(matched.baseline, one),) for one in hypotheses)))


@pytest.mark.parametrize('name, place', [
    ('actuator_gain', {'actuators': (0,)}), ('force_gain', {'pads': ('pad_1',)}),
    ('strain_stiffening', {})])
def test_a_cause_as_large_as_its_limit_makes_so_many_standard_deviations(breast, rich, cause,
                                                                         name, place):
    """By the full model with it, beside the same nuisances."""
    limit, made = made_at_limit(breast, rich, cause(name, **place))
    assert made == pytest.approx(SHOWS, rel=0.1)
    assert limit.term == name and 0.0 < limit.typical_sizes < FAR


def test_a_support_that_gives_way_shows_rather_earlier(breast, rich, cause):
    """The softer it is the less more softness does: its response is that of a typical one."""
    _, made = made_at_limit(breast, rich, cause('base_compliance'))
    assert SHOWS < made < 3.0 * SHOWS


def made_at_limit(lab, path, hypothesis):
    """(parts.Limit, standard deviations by the full model) of a cause in a recording."""
    matched = lab.watch(path)
    limit, = limits_of(assembled(matched, [hypothesis]))
    k = [s.label for s in hypothesis.strengths].index(limit.parameter)
    term = to_mapping(hypothesis.alone(k, limit.typical_sizes))
    effect = matched.observables.whiten(lab.changed(matched, {'name': hypothesis.name, **term}))
    return limit, detectability(matched.U, effect)[0]


def made_up(lengths, spread=1.0, cause='actuator_gain', name='gain', neutral=0.0, per_size=0.05):
    """An assembly of one cause at places where its response has these lengths [sd]."""
    strength = SimpleNamespace(name=name, label=name, spread=spread,
                               value=lambda amplitude: neutral + per_size * amplitude)
    hypotheses = [SimpleNamespace(name=cause, cls=by_name(cause),
                                  strengths=(strength,)) for _ in lengths]
    explanations = [SimpleNamespace(columns=length * np.eye(50)[:, :1]) for length in lengths]
    return SimpleNamespace(tried=SimpleNamespace(hypotheses=hypotheses), problem=SimpleNamespace(
        U=np.zeros((50, 1)), explanations=explanations))


def test_half_of_the_places_show_it_from_there_on():
    """Five, ten and twenty standard deviations: from half of the typical size on."""
    limit, = limits_of(made_up([20.0, 5.0, 10.0]))
    assert limit.typical_sizes == pytest.approx(0.5) and limit.value == pytest.approx(0.025)


def test_a_wide_prior_makes_nothing_easier_to_see():
    """The same response per typical size, written per prior of four of them."""
    assert limits_of(made_up([40.0], spread=4.0))[0].typical_sizes == pytest.approx(0.5)


def test_what_would_have_to_be_larger_than_anything_is_left_out():
    assert limits_of(made_up([0.4])) == () == limits_of(made_up([0.0]))
    assert len(limits_of(made_up([0.6]))) == 1


def test_what_would_have_to_be_more_than_the_parameter_can_is_left_out():
    """A bulk modulus of no size, by a response to 0.3 of it of four standard deviations."""
    kappa = {'cause': 'compressibility', 'name': 'factor', 'neutral': 1.0, 'per_size': -0.7}
    assert limits_of(made_up([4.0], **kappa))[0].value == pytest.approx(1.0 - 0.7 * SHOWS / 4.0)
    assert limits_of(made_up([3.0], **kappa)) == ()
