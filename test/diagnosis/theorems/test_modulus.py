"""T1 to T4: what positions and forces say of moduli, of memory and of force sensors."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.diagnosis.signals.motion import Path
from arm_brachy.diagnosis.signals.stream import EM, OPTICAL

SAME = 1e-9         # m: ten times what Newton leaves outstanding
HELD = 3.8          # s: in the first stand with a pad pushed, of every path
STIFFER = {'name': 'stiffness_scale', 'factor': 1.3}
WEIGHT = (0.0, 0.0, -9.81)
VISCOUS = {'name': 'viscoelasticity', 'g1': 0.3, 'tau1_s': 3.0}


def softer(scene, ratio):
    return replace(scene, material=replace(scene.material, E=ratio * scene.material.E))


@pytest.fixture(scope='module')
def heavy(scene, lab):
    """A soft breast under gravity, of which its model knows."""
    return lab(softer(replace(scene, gravity=WEIGHT), 1.0 / 3.0))


def moved(one, other):
    """Largest difference [m] of optical and EM positions."""
    return max(np.abs(one.optical - other.optical).max(), np.abs(one.em - other.em).max())


def test_t1_positions_are_those_of_any_modulus_and_forces_scale_with_it(breast, rich):
    plain, stiffer = breast.run(rich, HELD), breast.run(rich, HELD, STIFFER)
    assert moved(plain, stiffer) < SAME
    np.testing.assert_allclose(stiffer.force, 1.3 * plain.force, rtol=1e-6, atol=1e-6)


def test_t1_a_modulus_is_refused_without_forces(breast, rich, judge, others):
    found = judge([breast.watch(rich, STIFFER, kinds=(OPTICAL, EM))], others)
    assert found.verdict == 'nothing_missing' and found.modulus == {}


def test_t1_forces_give_it_and_nothing_is_missing(breast, rich, judge, others):
    found = judge([breast.watch(rich, STIFFER, seed=2)], others)
    assert found.verdict == 'nothing_missing'
    E = found.modulus['E']
    assert E.low < 1.3 * 6e3 < E.high and E.high - E.low < 0.03 * E.value


def test_t2_moduli_and_loads_scaled_together_change_no_position(scene, lab, once):
    """Ratios to mu: rho g R, k_base R, kappa, stiffening, fibres; and c mu R of the actuators."""
    found = [lab(softer(replace(scene, gravity=tuple(s * g for g in WEIGHT)), s)).run(
        once, 4.5, {'name': 'strain_stiffening'}, {'name': 'anisotropy'},
        {'name': 'base_compliance', 'normal_kPa_mm': s, 'tangential_kPa_mm': s},
        {'name': 'actuator_compliance', 'compliance_mm_N': 0.05 / s}) for s in (1.0, 1.3)]
    assert moved(*found) < 5e-7     # pads and forces are balanced to 0.1 um
    np.testing.assert_allclose(found[1].force, 1.3 * found[0].force, rtol=1e-3, atol=1e-4)


def test_t2_only_the_ratio_of_relaxation_to_pushing_time_counts(breast, once):
    t = np.array([3.4, 4.2, 6.0])
    slow = breast.run(once, t, VISCOUS)
    fast = breast.run(Path(0.5 * once.t, once.q), 0.5 * t, {**VISCOUS, 'tau1_s': 1.5})
    assert moved(slow, fast) < 1e-7     # the 20 ms step before an instant is not scaled
    np.testing.assert_allclose(slow.force, fast.force, rtol=1e-3, atol=1e-4)


def test_t2_a_known_weight_is_a_measure_of_force_for_positions(heavy, rich, judge, others):
    """With gravity, shape and density known, markers alone tell the modulus."""
    found = judge([heavy.watch(rich, STIFFER, kinds=(OPTICAL,))], others)
    assert found.verdict == 'nothing_missing'
    E = found.modulus['E']
    assert E.low < 1.3 * 2e3 < E.high


@pytest.fixture(scope='module')
def accurate(scene, lab):
    """Elements that do not lock: the volume, which does not relax, must be free of shear."""
    material = replace(scene.material, nu=0.4999)
    return lab(replace(scene, element='quadratic', material=material))


@pytest.fixture(scope='module')
def relaxing(cause, others):
    return [cause('viscoelasticity', ('g1',), tau1=3.0), *others]


def test_t3_uniform_relaxation_leaves_positions_and_changes_forces(accurate, gentle):
    """In the limit of no volume change and small strain not at all: here 0.7 % of the push."""
    plain, viscous = accurate.run(gentle, 3.2), accurate.run(gentle, 3.2, VISCOUS)
    assert moved(plain, viscous) < 0.01 * 3e-3
    assert np.abs(viscous.force - plain.force).max() > 0.3 * np.abs(plain.force).max()


@pytest.fixture(scope='module')
def gentle(pushes):
    return pushes(((1, 0, 0, 0), 3e-3, 20e-3), ((0, 1, 0, 0), 3e-3, 20e-3))


@pytest.mark.validate
def test_t3_uniform_relaxation_is_refused_without_forces(accurate, gentle, judge, relaxing):
    found = judge([accurate.watch(gentle, VISCOUS, kinds=(OPTICAL,))], relaxing)
    assert found.verdict == 'nothing_missing'


def test_t3_forces_show_it(accurate, gentle, judge, relaxing):
    found = judge([accurate.watch(gentle, VISCOUS)], relaxing)
    assert found.verdict == 'named' and found.names == {'viscoelasticity'}


@pytest.mark.validate
def test_t3_so_does_the_release_of_a_force(breast, pushes, judge, relaxing):
    """A known weight lies on the tissue for 3 s; what it leaves creeps back, markers alone.

    No verdict is asked for: creep under a force is not linear in what relaxes, and answers are.
    """
    weight = {'name': 'external_force', 'force_N': [0.0, 0.0, -4.0], 'centre_mm': [4, -5, 58],
              'radius_mm': 20, 'onset_s': 3.0, 'duration_s': 3.05}
    viscous = {**VISCOUS, 'g1': 0.15}
    path = pushes(((1, 0, 0, 0), 1e-3, 20e-3), ((0, 1, 0, 0), 1e-3, 20e-3), stand=3.0)
    assert moved(breast.run(path, 6.3, weight), breast.run(path, 6.3, weight, viscous)) > 1e-4
    found = judge([breast.watch(path, weight, viscous, kinds=(OPTICAL,), known=(weight,))],
                  relaxing)
    best, second, _ = found.decision.ranked
    assert best.causes == ('viscoelasticity',) and best.held_out > 50.0
    assert best.evidence - second.evidence > 50.0


@pytest.fixture(scope='module')
def gains(breast, cause, others):
    return [cause('force_gain', pads=()), *[cause('force_gain', pads=(name,))
                                            for name in breast.specimen.pads], *others]


def test_t4_a_gain_of_all_force_sensors_is_taken_for_the_modulus(breast, rich, judge, gains):
    found = judge([breast.watch(rich, {'name': 'force_gain', 'gain': 0.08})], gains)
    assert found.verdict == 'nothing_missing'
    assert found.modulus['E'].value == pytest.approx(1.08 * 6e3, rel=0.01)


def test_t4_a_gain_of_one_is_named_with_its_pad(breast, rich, judge, gains):
    one = {'name': 'force_gain', 'gain': 0.08, 'pads': ['pad_1']}
    found = judge([breast.watch(rich, one)], gains)
    assert found.verdict == 'named' and found.names == {'force_gain'}
    assert found.decision.accepted.explanations[0].variant == 'pad pad_1'
    assert found.modulus['E'].value == pytest.approx(6e3, rel=0.01)


def test_t4_a_known_weight_parts_the_gain_from_the_modulus(heavy, rich, judge, gains):
    found = judge([heavy.watch(rich, {'name': 'force_gain', 'gain': 0.3})], gains)
    assert found.verdict == 'named' and found.names == {'force_gain'}
    assert found.modulus['E'].value == pytest.approx(2e3, rel=0.1)
