"""A concealed bag holds nothing of the plant, in any byte, compressed or not."""

import pytest
from mcap.stream_reader import StreamReader
from ruamel.yaml import YAML

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording import encode
from arm_brachy.recording.conceal import conceal
from arm_brachy.recording.reader import BagReader, payload_hashes
from arm_brachy.recording.writer import SCENARIO, SCENE, BagWriter

TODAY_NS = 1_795_000_000 * 10**9
SCENARIO_TEXT = """\
# secretcomment
name: secretname
seed: 424242
description: secretprose
scene: ../scenes/secretplace.yaml
plant: {E_kPa: 77.125, terms: [{name: secretterm, width_mm: 0.875}]}
model: {E_kPa: 6.0}
tick_ms: 20.0
tasks: [{name: left, target: t1, axes: [x]}]
moves: [{name: right, speed_mm_s: 2}]
unforeseen: secretkey
"""
SCENE_TEXT = 'name: secretscene\ndescription: secretscenery\nmarkers: [{name: m0}]\n'
SECRETS = (b'secret', b'424242', b'77.125', b'0.875', b'truth', b'cafe', b'hostname')


@pytest.fixture
def source(make_bag):
    return make_bag(
        'secretbag', start_ns=TODAY_NS,
        attachments={SCENARIO: SCENARIO_TEXT, SCENE: SCENE_TEXT, 'mesh_plant.npz': b'secretmesh',
                     'mesh_scene.npz': b'nodes'},
        provenance={'name': 'secretname', 'seed': 424242, 'commit': 'cafe', 'machine': 'hostname',
                    'start': '2026-11-21'})


def contents(directory):
    """Every byte of a bag: the raw files, and each record of its chunks uncompressed."""
    files = b''.join(p.read_bytes() for p in sorted(directory.iterdir()))
    with next(directory.glob('*.mcap')).open('rb') as stream:
        records = ''.join(repr(record) for record in StreamReader(stream).records)
    return files + records.encode()


def test_no_secret_is_left(source, tmp_path):
    assert all(secret in contents(source) for secret in SECRETS)
    report = conceal(source, tmp_path / 'blind')
    left = contents(tmp_path / 'blind')
    assert [s for s in SECRETS if s in left] == []
    assert report['dropped'] == ['/truth/force/pad_0']
    bag = BagReader(tmp_path / 'blind')
    assert set(bag.metadata()) == {'rosbag2'}
    scenario = YAML(typ='safe').load(bag.attachment_text(SCENARIO))
    assert scenario['model'] == {'E_kPa': 6.0}
    assert (scenario['tasks'][0]['name'], scenario['seed']) == ('left', 0)
    assert scenario['moves'][0] == {'name': 'right', 'speed_mm_s': 2}
    assert set(bag.attachments()) == {SCENARIO, SCENE, 'mesh_scene.npz'}
    assert YAML(typ='safe').load(bag.attachment_text(SCENE))['markers'] == [{'name': 'm0'}]


def test_dates_become_durations(source, tmp_path):
    assert conceal(source, tmp_path / 'blind')['shift_s'] == TODAY_NS * 1e-9
    bag = BagReader(tmp_path / 'blind')
    assert bag.span_ns == (0, 49 * 10**7)
    for topic in bag.topics():
        t, _ = bag.series(topic, lambda m: 0.0)
        stamps, _ = bag.series(topic, lambda m: 0.0, clock='stamp')
        assert list(t) == list(stamps)
    assert '2026' not in (tmp_path / 'blind' / 'metadata.yaml').read_text()


def test_public_payloads_stay_as_they_were(make_bag, tmp_path):
    source = make_bag()
    conceal(source, tmp_path / 'blind')
    hashes = payload_hashes(source)
    del hashes['/truth/force/pad_0']
    assert payload_hashes(tmp_path / 'blind') == hashes


def test_stray_memory_in_padding_is_removed(tmp_path):
    data = encode.Encoder().wrench(0, 'w', [1.0, 2.0, 3.0])
    assert data[18:20] == bytes(2)  # padding after the two bytes of the frame's name
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/w', encode.WRENCH)
        bag.write('/w', data[:18] + b'\xca\xfe' + data[20:], 0)
    conceal(tmp_path / 'bag', tmp_path / 'blind')
    assert next(BagReader(tmp_path / 'blind').records()).data == data


def test_refusals(make_bag, tmp_path):
    with pytest.raises(RecordingError, match="no topic '/none'"):
        conceal(make_bag(), tmp_path / 'blind', also=['/none'])
    bad = make_bag('bad', attachments={SCENARIO: 'a: [1\n'})
    with pytest.raises(RecordingError, match='not YAML'):
        conceal(bad, tmp_path / 'blind')
    text = make_bag('text', attachments={SCENARIO: 'only words\n'})
    with pytest.raises(RecordingError, match='no mapping'):
        conceal(text, tmp_path / 'blind')
