"""The film of a misfit: the arrows are where the truth departs from the model, and by as much."""

import json

import numpy as np
import pytest

from arm_brachy.diagnosis.model.sensitivities import respond
from arm_brachy.diagnosis.report.misfit_film import (
    LONGEST,
    STEPS,
    misfit_film,
    misfit_note,
    misfit_states,
)
from arm_brachy.diagnosis.results.parts import Place
from arm_brachy.diagnosis.selection.problem import assemble
from arm_brachy.diagnosis.selection.screening import Tried
from arm_brachy.diagnosis.signals.stream import OPTICAL
from arm_brachy.viewing.film import UNIT

NOISE = 1e-4     # m, of a coordinate
PRESSED = {'name': 'external_force', 'force_N': [0.0, 0.0, -0.4], 'centre_mm': [-20.0, 13.0, 50.0],
           'radius_mm': 8.0, 'onset_s': 3.6, 'duration_s': 1.5}


@pytest.fixture(scope='module')
def assembly(breast, once, cause):
    """A recording during which somebody presses, and one that lacks nothing."""
    matched = (breast.watch(once, PRESSED, kinds=(OPTICAL,)), breast.watch(once, kinds=(OPTICAL,)))
    one = cause('external_force', ('force',), centre=(-0.02, 0.013, 0.05), radius=8e-3,
                onset=3.6, duration=1.5)
    responses = tuple(respond(m.baseline, one) for m in matched)
    return assemble(matched, Tried((one,), (responses,)), sound=1)


@pytest.fixture(scope='module')
def states(assembly):
    return misfit_states(assembly, assembly.problem.explanations[:1])


def test_a_recording_that_may_lack_something_is_shown_at_its_states(assembly, states):
    off = assembly.matched[0]
    assert np.array_equal(states.t, off.baseline.t)
    assert np.allclose(states.x[-1], off.baseline.x(len(states.t) - 1)[states.surface.nodes])


def test_arrows_show_the_push_where_and_when_it_was_and_lose_it_with_the_cause(
        assembly, states, breast):
    """Share of what the force did to the markers that arrows show; nuisances may take some."""
    did = breast.changed(assembly.matched[0], PRESSED)[OPTICAL][..., 0]

    def share(left):
        markers = left[:, :did.shape[1]]
        seen = np.isfinite(markers).all(axis=2)
        return np.sum(markers[seen] * did[seen]) / np.sum(did[seen]**2)
    assert 0.6 < share(states.before) < 1.2 and abs(share(states.after)) < 0.2
    off = np.linalg.norm(states.before, axis=2)
    state, marker = np.unravel_index(np.nanargmax(off), off.shape)
    assert off[state, marker] > 3.0 * NOISE and 3.6 <= states.t[state] <= 5.1
    assert marker == np.linalg.norm(did[state], axis=1).argmax()


def test_the_film_has_every_state_and_draws_the_region(states):
    spot = Place(position=(0.01, 0.02, 0.03), radius=5e-3, term='inclusion')
    film = json.loads(misfit_film(states, (spot, Place(stream=OPTICAL))))
    assert [frame[0] for frame in film['frames']] == pytest.approx(states.t, abs=1e-3)
    assert 3.6 <= film['frames'][film['start']][0] <= 5.1      # opens where somebody presses
    regions = [s for s in film['shapes'] if s['k'] == 'ellipsoid']
    assert len(regions) == 1 and np.allclose(np.array(regions[0]['d']) * UNIT, 0.01)
    last = [film['shapes'][k] for k in film['frames'][-1][1]]
    arrows = [np.reshape(s['p'], (2, 3)) * UNIT for s in last
              if s['k'] == 'arrow' and film['layers'][s['l']] == 'off, without new physics']
    seen = np.isfinite(states.before[-1]).all(axis=1)
    drawn = np.array([tip - foot for foot, tip in arrows])
    assert np.allclose(drawn, states.scale * states.before[-1][seen], atol=2 * UNIT)


def test_the_note_says_which_recording_and_how_much_longer_the_arrows_are(states):
    note, most = misfit_note(states), np.nanmax(np.linalg.norm(states.before, axis=2))
    assert 'made up' in note and f'{states.scale:g} times as long' in note
    assert states.scale in STEPS and LONGEST / 3.0 < states.scale * most <= LONGEST
