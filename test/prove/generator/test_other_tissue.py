"""Other laws of tissue and boundary: like the registry's, not the same, and what each says."""
from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.prove.generator.body import COARSE
from arm_brachy.prove.generator.case import TERMS, draw
from arm_brachy.prove.generator.catalogue import draw_effect
from arm_brachy.prove.generator.form import REGISTRY
from arm_brachy.prove.generator.forms import OTHER, act_of, in_some_form, same_values
from arm_brachy.prove.generator.history import MEMORY, law_of
from arm_brachy.prove.generator.other_boundary import OTHER_MOTION, breath_that_pauses
from arm_brachy.prove.generator.other_tissue import inner_half
from arm_brachy.prove.generator.plant import DRIFTS, build_world
from arm_brachy.prove.generator.probe import locate
from arm_brachy.prove.generator.response import outputs
from arm_brachy.prove.generator.tissue import STATIC, TIMED

SOLVED = {**STATIC, **TIMED}
FORMS = [(name, form) for name in SOLVED for form in sorted(OTHER[name])]
# Other in their course over time alone.
COURSES = [('external_force', 'rises_and_falls'), ('breathing', 'pausing'),
           ('swelling_drift', 'levels_off')]
MARKER, FORCE = 5e-5, 0.03      # m, N: noise of the sensors, about


@pytest.fixture(scope='module')
def bench(body):
    """Function of an effect: what it changes (o,), markers [m] and forces [N], both pads in."""
    plain = body.model(body.grid(COARSE))
    y = np.array([0.7 * pad.stroke for pad in body.pads])
    start = plain.follow(plain.rest(), y)
    probes = locate(body.points, plain.grid.mesh.nodes, plain.grid.mesh.tets)
    before, known = outputs(plain, probes, start), {}

    def change(effect):
        key = repr(effect)
        if key not in known:
            made = act_of(effect, SOLVED)(plain, body, effect.values, 1.0)
            model = made[0] if effect.name in TIMED else made
            known[key] = outputs(model, probes, model.newton(start, y, most=25)) - before
        return known[key]
    return change


def drawn(name, body, form=REGISTRY):
    """The effect at its typical size, the same places for all forms."""
    rng = np.random.default_rng(4)
    return replace(draw_effect(rng, name, body), form=form)


def whitened(change, markers):
    """Changes of places [m], the first, and of forces [N] over the noise."""
    return np.r_[change[:markers] / MARKER, change[markers:] / FORCE]


def cosine(a, b):
    return a @ b / np.linalg.norm(a) / np.linalg.norm(b)


def test_every_term_has_two_other_laws_at_least():
    assert {name for name, forms in OTHER.items() if len(forms) >= 2} == set(TERMS)


def test_what_means_the_same_is_a_value(body):
    for name, forms in OTHER.items():
        for form in forms:
            effect = drawn(name, body, form)
            assert set(same_values(effect)) <= set(effect.values), (name, form)


def test_half_of_the_draws_are_the_registrys(body):
    rng, effect = np.random.default_rng(1), drawn('gravity', body)
    forms = [in_some_form(rng, effect).form for _ in range(400)]
    assert abs(forms.count(REGISTRY) - 200) < 60       # six standard deviations
    assert set(forms) == {REGISTRY, *OTHER['gravity']}


@pytest.mark.parametrize(('name', 'form'), FORMS, ids=lambda v: v)
def test_another_law_is_like_the_registrys_and_not_the_same(bench, body, name, form):
    own, other = (whitened(bench(effect), 3 * len(body.points))
                  for effect in (drawn(name, body), drawn(name, body, form)))
    assert cosine(other, own) > 0.5
    assert 0.4 < np.linalg.norm(other) / np.linalg.norm(own) < 2.0
    apart = np.linalg.norm(other - own) / np.linalg.norm(own)
    assert apart == 0.0 if (name, form) in COURSES else apart > 0.01


@pytest.mark.parametrize(('name', 'form'), COURSES, ids=lambda v: v)
def test_a_course_of_another_law_begins_where_the_registrys_does(body, name, form):
    """Its first harmonic, of what comes back, may be early or late."""
    model, t = body.model(body.grid(COARSE)), np.linspace(0.0, 100.0, 5001)
    own, other = (act_of(e, SOLVED)(model, body, e.values, 1.0)[1](t, np.zeros((len(t), 2)))
                  for e in (drawn(name, body), drawn(name, body, form)))
    assert np.linalg.norm(other - own) > 0.1 * np.linalg.norm(own)
    if name != 'breathing':
        np.testing.assert_allclose(other[own == 0.0], 0.0, atol=1e-12)
        assert cosine(other, own) > 0.5


def test_the_inner_half_is_half_and_inside(body):
    model = body.model(body.grid(COARSE))
    inside, volume = inner_half(model, body), model.grid.slopes[1]
    assert abs(volume[inside].sum() / volume.sum() - 0.5) < 0.01
    reach = np.linalg.norm(model.grid.points / [*body.dome.radii, body.dome.height], axis=2)
    assert reach[inside].max() <= reach[~inside].min()


def test_steps_of_two_layers_have_the_gradient_on_average(body):
    model = body.model(body.grid(COARSE))
    effect = drawn('stiffness_gradient', body, 'two_layers')
    planted = act_of(effect, SOLVED)(model, body, effect.values, 1.0)
    x, w = model.grid.points.reshape(-1, 3), model.grid.slopes[1].ravel()
    g = np.array(effect.values['gradient_per_m'])
    s = (x - w @ x / w.sum()) @ (g / np.linalg.norm(g))
    log = np.log(planted.tissue.mu / model.tissue.mu).ravel()
    slope = (w * s * (log - w @ log / w.sum())).sum() / (w * s * s).sum()
    assert slope == pytest.approx(np.linalg.norm(g), rel=0.02)


@pytest.mark.parametrize('form', ['ellipsoid', 'soft_edge'])
def test_other_lumps_hold_what_the_sphere_holds(body, form):
    """The integral of the logarithm of the modulus, as well as a coarse mesh resolves it."""
    model = body.model(body.grid(COARSE))
    effect = drawn('inclusion', body, form)
    values = {**effect.values, 'radius_mm': 11.0,
              'centre_mm': (0.0, 0.0, 0.45e3 * body.dome.height)}
    planted = act_of(effect, SOLVED)(model, body, values, 1.0)
    log = np.log(planted.tissue.mu / model.tissue.mu)
    held = (log * model.grid.slopes[1]).sum() / np.log(values['ratio'])
    assert held == pytest.approx(4 / 3 * np.pi * 0.011**3, rel=0.15)


@pytest.mark.parametrize('form', ['heavy_inside', 'heavy_below'])
def test_uneven_density_keeps_the_weight(body, form):
    model = body.model(body.grid(COARSE))
    even, uneven = (act_of(e, SOLVED)(model, body, e.values, 1.0).loads[-1].nodal.sum(0)
                    for e in (drawn('gravity', body), drawn('gravity', body, form)))
    np.testing.assert_allclose(uneven, even, rtol=0.02)


def test_a_breath_that_pauses_goes_as_far_and_has_no_mean():
    v = {'frequency_Hz': 0.25, 'phase_deg': 40.0}
    s = breath_that_pauses(v, np.arange(0.0, 4.0, 1e-3))
    assert np.ptp(s) == pytest.approx(2.0, abs=1e-4)
    assert abs(s.mean()) < 1e-3
    assert (s < 0).mean() > 0.55                        # it stays longest breathed out
    assert 2 * abs(np.mean(s * np.exp(-2j * np.pi * 0.25 * np.arange(0.0, 4.0, 1e-3)))) == \
        pytest.approx(1.0, abs=1e-3)                   # its first harmonic has the amplitude


def test_a_base_that_bulges_leaves_its_rim_and_the_plate(body, cache):
    null = draw(np.random.default_rng(7), 'null', body)
    effect = drawn('breathing', body, 'bulging')
    model, _ = act_of(effect, SOLVED)(body.model(body.grid(COARSE)), body, effect.values, 1.0)
    nodes = model.grid.nodes[model.grid.mesh.base_nodes]
    away = np.linalg.norm(nodes[:, :2] / body.dome.radii, axis=1)
    size = np.linalg.norm(model.shift, axis=1) / (1e-3 * effect.values['amplitude_mm'])
    assert size[away < 0.1].min() > 0.98 and size[away > 0.999].max() < 0.01
    world = build_world(replace(null, effects=(effect,)), cache)
    t = np.linspace(0.0, 5.0, 20)
    markers = world.markers(t, np.zeros((20, len(body.pads))))
    assert not np.ptp(markers[:, -3:], axis=0).any()
    assert np.ptp(markers[:, 0], axis=0).any()
    assert set(OTHER_MOTION) == set(OTHER['breathing'])


@pytest.mark.parametrize('form', sorted(OTHER['stiffness_drift']))
def test_other_drifts_begin_at_the_onset_and_lag_behind(form, body):
    effect = drawn('stiffness_drift', body, form)
    v = {**effect.values, 'rate_per_min': 0.2, 'onset_s': 10.0}
    t = np.linspace(0.0, 70.0, 701)
    own, other = DRIFTS['stiffness_drift'](v)(t), act_of(effect, DRIFTS)(v)(t)
    assert (other[t <= 10] == 1).all() and (np.diff(other[t >= 10]) > 0).all()
    assert (other[t > 10.2] < own[t > 10.2]).all()
    assert other[-1] - 1 > 0.5 * (own[-1] - 1)


def test_other_relaxations_lose_the_same_share(body):
    effect = drawn('viscoelasticity', body)
    own = law_of((effect,), 1.0)
    for form, branches in (('one_time', 1), ('many_times', 4)):
        law = law_of((replace(effect, form=form),), 1.0)
        assert len(law.times) == len(law.shares) == branches
        assert sum(law.shares) == pytest.approx(sum(own.shares))
        assert min(own.times) / 3.1 < min(law.times) <= max(law.times) < 3.1 * max(own.times)


@pytest.mark.parametrize('form', [REGISTRY, *sorted(OTHER['stress_softening'])])
def test_damage_grows_from_none_to_all(form, body):
    """Its rate is the derivative of what is kept."""
    effect = drawn('stress_softening', body, form)
    law = act_of(effect, MEMORY)({'damage': 0.4, 'energy_Pa': 50.0})
    energy = np.linspace(0.0, 5e4, 200_001)[None]
    kept = law.kept(Remembered(energy))
    assert kept[0, 0] == 1.0 and (np.diff(kept) <= 0).all()
    assert kept[0, -1] == pytest.approx(0.6, abs=1e-3)
    middle = Remembered((energy[:, 1:] + energy[:, :-1]) / 2)
    rate = -np.diff(kept) / np.diff(energy)
    smooth = np.abs(middle.energy - 50.0 / 3) > 1.0    # where a threshold is, there is a kink
    found = law.loss(Remembered(0 * middle.energy - 1), middle)
    np.testing.assert_allclose(found[smooth], rate[smooth], rtol=1e-3, atol=1e-12)


class Remembered:
    """What of a Memory is the largest energy (m, q) [Pa]."""

    def __init__(self, energy):
        self.energy = energy
