"""What a person reads of where a candidate acts: mm and names of pads, no metres, no indices."""

import numpy as np
import pytest

from arm_brachy.diagnosis.results.channels import channel, whereabouts
from arm_brachy.registry import by_name

PADS = ('east', 'west')


@pytest.mark.parametrize(('term', 'place', 'said'), [
    ('inclusion', {'centre': (np.float64(0.023), -0.043, 0.0)}, 'centre (23.0, -43.0, 0.0) mm'),
    ('backlash', {'actuators': (1,)}, 'actuator west'),
    ('backlash', {'actuators': ()}, 'all actuators'),
    ('force_gain', {'pads': ('east',)}, 'pad east'),
    ('force_gain', {'pads': ()}, 'all pads'),
    ('em_offset', {'tools': ('lump',)}, 'tool lump'),
    ('em_distortion', {'pad': -1}, 'all pads'),
    ('em_distortion', {'metal': (0.08, 0.0, 0.02), 'carrier': 0},
     'metal (80.0, 0.0, 20.0) mm, pad east'),
    ('clock_offset', {'stream': 'em'}, 'EM tracker'),
    ('marker_slip', {'marker': 'm1', 'onset': 3.2}, 'marker m1, onset 3.2 s'),
    ('anisotropy', {'azimuth': -0.25 * np.pi, 'elevation': 0.0},
     'azimuth -45 deg, elevation 0 deg'),
    ('gravity', {}, '')])
def test_a_place_is_said_in_mm_and_by_name(term, place, said):
    assert whereabouts(by_name(term), place, PADS) == said


def test_all_pads_of_a_body_with_one_are_that_one():
    assert channel('actuators', (), ('east',)) == 'actuator east'
    assert channel('pads', ('east', 'west'), PADS) == 'pads east and west'
