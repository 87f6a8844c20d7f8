"""Message definitions of the project for a tree whose messages are not built yet."""

import os
import sys
from pathlib import Path

import pytest

from arm_brachy.recording import encode, writer

MSG_DEFS = Path(__file__).resolve().parents[2] / 'msg_defs'


@pytest.fixture(autouse=True)
def message_packages(tmp_path_factory, monkeypatch):
    """Lets arm_brachy_msgs be found in the source tree where it is not installed."""
    installed = Path(sys.prefix, 'share', 'arm_brachy_msgs', 'msg', 'OpticalFrame.msg')
    if not installed.is_file():
        prefix = tmp_path_factory.getbasetemp() / 'prefix'
        link = prefix / 'share' / 'arm_brachy_msgs'
        if not link.exists():
            link.parent.mkdir(parents=True)
            link.symlink_to(MSG_DEFS)
        others = os.environ.get('AMENT_PREFIX_PATH', sys.prefix)
        monkeypatch.setenv('AMENT_PREFIX_PATH', f'{prefix}{os.pathsep}{others}')


@pytest.fixture
def make_bag(tmp_path):
    """A bag with an encoder stream, an optical stream and a topic of the truth."""

    def make(name='bag', *, n=50, start_ns=0, attachments=None, provenance=None):
        encoder = encode.Encoder()
        with writer.BagWriter(tmp_path / name, attachments=attachments,
                              provenance=provenance) as bag:
            bag.add_topic('/actuators/state', encode.JOINT_STATE)
            bag.add_topic('/optical/markers', encode.OPTICAL)
            bag.add_topic('/truth/force/pad_0', encode.WRENCH)
            for k in range(n):
                t = start_ns + k * 10_000_000
                bag.write('/actuators/state',
                          encoder.joint_state(t, 'world', ['pad_0'], [1e-3 * k]), t, sequence=k)
                bag.write('/optical/markers',
                          encoder.optical_frame(t, 'world', k, ['m0'], [[k, 0.0, 1.0]]), t)
                bag.write('/truth/force/pad_0', encoder.wrench(t, 'world', [0.0, 0.0, k]), t)
        return tmp_path / name

    return make
