"""Pads that come loose, condensed: friction in closed form; full runs with the plant's contact."""

from dataclasses import replace

import numpy as np
import pytest

from arm_brachy.devices.terms.actuator_gain import ActuatorGain
from arm_brachy.diagnosis.model import pad_friction
from arm_brachy.diagnosis.model.face_contact import FaceContact
from arm_brachy.diagnosis.model.forward import ForwardModel
from arm_brachy.diagnosis.model.hypothesis import hypothesis
from arm_brachy.diagnosis.model.linearised import Baseline
from arm_brachy.diagnosis.model.pad_friction import NEAR
from arm_brachy.diagnosis.model.rigid_face import Face
from arm_brachy.diagnosis.model.sensitivities import loosened_change, respond
from arm_brachy.diagnosis.selection.screening import triable
from arm_brachy.registry import by_name
from arm_brachy.tissue.contact_shapes import Disc
from arm_brachy.tissue.contact_surface import SurfaceQuadrature
from arm_brachy.tissue.terms.breathing import Breathing
from arm_brachy.tissue.terms.gravity import Gravity
from arm_brachy.tissue.terms.inclusion import Inclusion
from arm_brachy.tissue.terms.pad_slip import PadSlip

# Loading and unloading at one place, deep, the other pad alone (t = 7.8 on).
STATES = np.array([0.5, 1.2, 2.5, 4.3, 6.5, 8.0, 9.0])
COMPLIANCE, FRICTION = 0.02, 0.3    # m/N of every node, coefficient
PRESSED = 1e-3                      # m
LAYER = (1e10, 1e-5, 1e9)            # Pa/m, m, Pa/m: gives way by micrometres


@pytest.fixture
def pressed():
    """(FaceContact, y0, state): a plate on a triangle whose nodes are springs, pressed 1 mm."""
    y0 = np.array([[0.0, 0.0, 0.0], [6e-3, 0.0, 0.0], [0.0, 6e-3, 0.0]])
    shape = np.array([[4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]]) / 6.0
    surface = SurfaceQuadrature(np.array([[0, 1, 2]]), shape, np.full((1, 3), 6e-6))
    face = Face(surface, np.eye(3), np.zeros(3), Disc(0.1, 1e-3).core, FRICTION, LAYER)
    contact = FaceContact([face], COMPLIANCE * np.eye(9))
    start = contact.start(y0, np.zeros((1, 3)))
    return contact, y0, contact.step(start, y0, np.array([[0.0, 0.0, PRESSED]]))


def dragged(pressed, ways):
    """Forces (3,) [N] on the plate after each way [m] along x."""
    contact, y0, state = pressed
    out = []
    for way in ways:
        state = contact.step(state, y0, np.array([[way, 0.0, PRESSED]]))
        out.append(state.forces[0])
    return np.array(out)


def test_a_plate_is_pushed_back_and_dragged_as_springs_and_coulomb_say(pressed):
    """It sticks for mu times the depth, then is dragged by mu times its load; and back again."""
    load, stiffness = 3.0 * PRESSED / COMPLIANCE, 3.0 / COMPLIANCE
    assert pressed[2].forces[0] == pytest.approx([0.0, 0.0, -load], abs=0.02 * load)
    reach = FRICTION * PRESSED
    found = dragged(pressed, np.array([0.5, 2.0, 4.0, 3.5, 1.0]) * reach)[:, 0]
    drag = FRICTION * load
    back = 0.5 * reach * stiffness - drag      # half a reach back: sticks, less the spring's way
    assert found == pytest.approx([-0.5 * drag, -drag, -drag, back, drag], abs=0.03 * drag)


def test_a_plate_that_lifts_off_bears_nothing(pressed):
    contact, y0, state = pressed
    state = contact.step(state, y0, np.array([[1e-3, 0.0, -1e-6]]))
    assert not state.p.any() and np.allclose(state.y, y0, rtol=0.0, atol=1e-12)


@pytest.fixture
def shallow(encoder):
    """The path at half its depth: pushes to 4 mm."""
    return replace(encoder, q=0.5 * encoder.q)


def errors(baseline, term, near):
    """Kind -> error of the condensed change over that of a full run with the plant's contact."""
    model = baseline.model
    full = ForwardModel(model.specimen, (*model.terms, term)).predict(baseline.encoder,
                                                                      baseline.t)
    assert full.valid.all()
    out = {}
    for kind, change in loosened_change(baseline, term, near).items():
        expected = full.get(kind) - baseline.shown[kind]
        out[kind] = np.linalg.norm(change - expected) / np.linalg.norm(expected)
    return out


@pytest.mark.parametrize(('pads', 'friction'), [
    (('pad_1',), 0.1), pytest.param(('pad_2',), 0.3, marks=pytest.mark.validate)])
def test_changes_are_those_of_full_runs(quadratic, encoder, pads, friction):
    """Pushes to 8 mm."""
    baseline = Baseline(ForwardModel(quadratic), encoder, STATES)
    found = errors(baseline, PadSlip(friction, pads=pads), NEAR)
    assert max(found.values()) < 0.08 and found['force'] < 0.02, found


def test_a_pad_that_stands_back_is_an_offset_of_its_actuator(quadratic, shallow):
    """The plant's way to stand back, beside another pad that pushes the tissue towards it."""
    back, term = 2e-4, PadSlip(0.3, pads=('pad_1',))
    baseline = Baseline(ForwardModel(quadratic), shallow, STATES)
    late = ActuatorGain(gain=0.0, offset=-back, actuators=(0,))
    full = [ForwardModel(quadratic, terms).predict(shallow, STATES)
            for terms in ((term,), (late, term))]
    found = [loosened_change(baseline, term, NEAR, one) for one in (0.0, back)]
    for kind in ('optical', 'force'):
        expected = full[1].get(kind) - full[0].get(kind)
        shift = found[1][kind] - found[0][kind]
        if kind == 'optical':   # the marker on the pad goes with it
            rides = baseline.model.attached.on_pad[:expected.shape[1], 0] > 0.0
            expected, shift = expected[:, ~rides], shift[:, ~rides]
        assert np.linalg.norm(shift - expected) < 0.15 * np.linalg.norm(expected), kind


def test_one_compliance_will_do_to_find_out_what_slips(quadratic, shallow):
    """What it leaves out, how tissue stiffens under a pad, grows with the push: 4 mm."""
    baseline = Baseline(ForwardModel(quadratic), shallow, STATES)
    found = errors(baseline, PadSlip(0.1, pads=('pad_1',)), np.inf)
    assert max(found.values()) < 0.15 and found['force'] < 0.03, found


def test_all_pads_of_a_body_with_weight_and_an_inclusion(quadratic, shallow):
    known = (Gravity(added=(0.0, 0.0, -9.81)), Inclusion(centre=(0.03, 0.0, 0.03), ratio=5.0))
    baseline = Baseline(ForwardModel(quadratic, known), shallow, STATES)
    found = errors(baseline, PadSlip(0.3), NEAR)
    assert max(found.values()) < 0.15, found


def test_beside_memory_it_is_run_in_full(linear, encoder):
    model = ForwardModel(linear, (Breathing(amplitude=1e-3),))
    baseline = Baseline(model, encoder, STATES[:2])
    assert respond(baseline, hypothesis(PadSlip, pads=('pad_1',))).exact
    assert triable(PadSlip, remembers=True) and not triable(PadSlip)


def test_only_friction_tells_unloading_from_loading(linear, encoder, monkeypatch):
    """Pad 1 at 2 mm on its way in and held there after 6 mm, in steps of 0.2 mm.

    In steps of 4 mm the walk has a loop of its own, up to 3e-3 N.
    """
    monkeypatch.setattr(pad_friction, 'FINDING', pad_friction.Walk(2e-4, 1e-3, 1e-10))
    baseline = Baseline(ForwardModel(linear), encoder, np.array([1.2, 2.5, 4.3]))
    one = hypothesis(by_name('pad_slip'), pads=('pad_1',))
    rough, smooth = (respond(baseline, one, scale=scale) for scale in (1.0, 1e6))
    loop = [np.linalg.norm(np.ptp(r.scale * r.values['force'][[0, 2], 0, :, 0], axis=0))
            for r in (rough, smooth)]
    assert loop[0] > 0.01 > 1000.0 * loop[1]


def test_a_pad_that_stands_back_bears_nothing(linear, encoder):
    baseline = Baseline(ForwardModel(linear), encoder, STATES[:3])
    change = respond(baseline, hypothesis(by_name('pad_slip'), pads=('pad_1',))).values
    assert np.abs(change['force'][0]).max() < 1e-6 and np.abs(change['optical'][0]).max() < 1e-8
    along = baseline.model.directions[0]
    bonded = baseline.shown['force'][1:, 0] @ along
    borne = bonded + change['force'][1:, 0, :, 0] @ along
    assert (bonded < borne).all() and (borne < 0.0).all()   # later, and against the push
