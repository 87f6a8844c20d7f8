"""Only who reads the key file can seal; a seal covers topic, order and content."""

import os

import pytest

from arm_brachy.core.errors import ConfigError
from arm_brachy.core.session import SealError, Session, place_of, unsealed

TOPIC, NOW = '/actuators/command', 1_800_000_000_000_000_000


@pytest.fixture
def key_file(tmp_path):
    path = tmp_path / 'bag.key'
    Session.create(path)
    return path


def test_the_key_is_readable_by_its_owner_alone_and_new_each_time(key_file):
    first = key_file.read_text()
    assert os.stat(key_file).st_mode & 0o777 == 0o600
    Session.create(key_file)
    assert key_file.read_text() != first


@pytest.mark.parametrize('n', range(4, 12))
def test_what_one_process_seals_another_opens_whole(key_file, n):
    data = Session.load(key_file).seal(TOPIC, b'\x00\x01\x02\x03ABSEAL1 hello'[:n], NOW)
    assert len(data) % 4 == 0 and len(data) >= n
    assert Session.load(key_file).open(TOPIC, data) == b'\x00\x01\x02\x03ABSEAL1 hello'[:n]
    assert unsealed(data) == b'\x00\x01\x02\x03ABSEAL1 hello'[:n]


def refused(session, data, topic=TOPIC):
    with pytest.raises(SealError) as caught:
        session.open(topic, data)
    return str(caught.value)


def test_a_stranger_a_changed_byte_and_another_topic_are_refused(key_file, tmp_path):
    mine, stranger = Session.load(key_file), Session.create(tmp_path / 'other.key')
    data = Session.load(key_file).seal(TOPIC, bytes(20), NOW)
    assert refused(mine, bytes(20)) == refused(mine, b'') == 'no seal'
    assert refused(mine, stranger.seal(TOPIC, bytes(20), NOW)) == 'wrong seal'
    assert refused(mine, data, '/needle/command') == 'wrong seal'
    for i in [*range(20), *range(len(data) - 40, len(data))]:
        changed = bytearray(data)
        changed[i] ^= 1
        assert refused(mine, bytes(changed)) == 'wrong seal', i
    assert mine.open(TOPIC, data) == bytes(20)      # what was refused does not count


def test_a_replay_and_a_late_one_are_refused_and_a_restarted_sender_is_heard(key_file):
    sender, mine = Session.load(key_file), Session.load(key_file)
    first, second = (sender.seal(TOPIC, p, NOW) for p in (b'aaaa', b'bbbb'))
    assert mine.open(TOPIC, second) == b'bbbb'
    assert refused(mine, first) == refused(mine, second) == 'sent again or out of order'
    again = Session.load(key_file).seal(TOPIC, b'cccc', NOW + 1000)
    assert mine.open(TOPIC, again) == b'cccc'


def test_a_ticket_serves_once_for_its_action_for_a_minute(key_file, tmp_path):
    ticket = Session.load(key_file).ticket('release', NOW)
    mine = Session.load(key_file)
    assert mine.refusal(ticket, 'home', NOW) == 'no ticket for home'
    assert 'older' in mine.refusal(ticket, 'release', NOW + 61 * 10**9)
    assert mine.refusal(ticket, 'release', NOW + 10**9) == ''
    assert 'used' in mine.refusal(ticket, 'release', NOW + 10**9)
    forged = Session.create(tmp_path / 'other.key').ticket('release', NOW + 1)
    assert 'another session' in mine.refusal(forged, 'release', NOW)
    for rubbish in ('', 'release', 'release:x:y', f'release:{"9" * 30}:00', 'release:1:é'):
        assert mine.refusal(rubbish, 'release', NOW)


def test_tickets_of_different_actions_may_arrive_in_any_order(key_file):
    holder, mine = Session.load(key_file), Session.load(key_file)
    first, second = holder.ticket('home', NOW), holder.ticket('release', NOW + 1)
    assert mine.refusal(second, 'release', NOW) == mine.refusal(first, 'home', NOW) == ''


def test_a_key_file_says_where_its_cell_is(tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '31')
    for place, found in ((('71', 'lab/left'), ('71', 'lab/left')), (('71',), ('71', '')),
                         ((), ('31', ''))):
        Session.create(tmp_path / 'bag.key', *place)
        assert place_of(tmp_path / 'bag.key') == found


def test_a_bad_key_file_is_named(tmp_path, key_file):
    with pytest.raises(ConfigError, match='no session key'):
        Session.load(tmp_path / 'none')
    key_file.chmod(0o644)
    with pytest.raises(ConfigError, match='mode 0644 lets others read'):
        Session.load(key_file)
    for text in ('', 'beef', 'z' * 64):
        bad = tmp_path / 'bad.key'
        bad.write_text(text)
        with pytest.raises(ConfigError, match='holds no session key'):
            Session.load(bad)
