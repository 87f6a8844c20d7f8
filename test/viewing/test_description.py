"""The URDF against PyBullet, which reads it, and frames on /tf against the arm's kinematics."""

from xml.etree import ElementTree

import numpy as np
import pytest

from arm_brachy.cell import arm_base_name, arm_frames, build_description, build_stage
from arm_brachy.core.paths import config_dir
from arm_brachy.robot.panda_parameters import DH
from arm_brachy.robot.rigid_body import frames
from arm_brachy.robot.simulation import pybullet
from arm_brachy.scenario import load_cell
from arm_brachy.viewing.description import arm_links

Q = np.array([0.3, -0.4, 0.2, -2.1, 0.1, 1.7, -0.5])


@pytest.fixture(scope='module')
def cell():
    return load_cell(config_dir() / 'scenarios' / 'procedure.yaml')


def test_links_of_the_arm_are_where_its_kinematics_has_them():
    R, p = np.eye(3), np.zeros(3)
    for i, (parent, child, turn, shift) in enumerate(arm_links(DH, Q)):
        p, R = p + R @ shift, R @ turn
        assert (parent, child) == (f'arm_link_{i}', f'arm_link_{i + 1}')
        assert np.allclose(R, frames(DH, Q)[0][i]) and np.allclose(p, frames(DH, Q)[1][i])


def test_pads_of_the_model_stand_where_they_are_drawn(cell, tmp_path):
    """Another reader of URDF moves the joints; the frame keeps the axes of the base."""
    file = tmp_path / 'cell.urdf'
    file.write_text(build_description(cell, 'cell_base'))
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(file), useFixedBase=True, physicsClientId=client)
        links = {}
        for i in range(pybullet.getNumJoints(body, physicsClientId=client)):
            info = pybullet.getJointInfo(body, i, physicsClientId=client)
            links[info[12].decode()] = i
            if info[2] == pybullet.JOINT_PRISMATIC:
                pybullet.resetJointState(body, i, 0.012, physicsClientId=client)
        where = {name: pybullet.getLinkState(body, i, physicsClientId=client)[4:6]
                 for name, i in links.items()}
    finally:
        pybullet.disconnect(client)
    pads = build_stage(cell, cell.scenario.viewer).pads
    assert len(pads) == len(cell.scene.pads) and 'arm_link_7' in where
    for pad in pads:
        assert np.allclose(where[pad.name][0], pad.at(0.012), atol=1e-9)
        assert np.allclose(where[pad.name][1], [0, 0, 0, 1])


def test_every_frame_of_the_linkage_is_a_link_of_the_model():
    """What a viewer is told on /tf it finds in the URDF, under the base that it was told."""
    other = load_cell(config_dir() / 'scenarios' / 'probe_scissor.yaml')
    links = {link.get('name') for link in ElementTree.fromstring(
        build_description(other, 'cell_base')).iter('link')}
    named = {arm_base_name(other)}
    for parent, child, _, _ in arm_frames(other, np.array([0.2, 0.8, -1.5, 0.15])):
        assert parent in named and child in links
        named.add(child)
    assert 'scissor_probe' in named and named <= links
