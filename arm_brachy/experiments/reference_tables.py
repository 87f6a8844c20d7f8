"""Tables of the reference pages: keys of every file, fields of every message.

Test: experiments/test_readme.py, test_docs.py
"""

import re

from arm_brachy.core.config import key_rows
from arm_brachy.core.paths import share_dir
from arm_brachy.core.scene import Scene
from arm_brachy.diagnosis.settings import Calibration
from arm_brachy.recording.csv_map import ColumnMap
from arm_brachy.recording.topic_map import TopicMap
from arm_brachy.scenario import Scenario

FILES = {'scene': Scene, 'scenario': Scenario, 'columns': ColumnMap, 'topics': TopicMap,
         'calibration': Calibration}
DEFINITIONS = 'msg_defs'
# What follows a bar, by the kind of the definition.
PARTS = {'.msg': (), '.srv': ('**response**',), '.action': ('**result**', '**feedback**')}
FIELD = re.compile(r'([\w/]+(?:\[\d*\])?) +(\w+)(=\d+)?(?: *# *(.*))?')


def keys(name):
    """Markdown table of the keys that a file of one of FILES may hold."""
    rows = key_rows(FILES[name])
    return _table(('key', 'default', 'allowed', 'meaning'),
                  [(f'`{key}`', *rest) for key, *rest in rows])


def messages(results):
    """Markdown sections of all messages, services and actions of arm_brachy_msgs, by name."""
    folder = share_dir() / DEFINITIONS
    paths = [path for kind in ('msg', 'srv', 'action')
             for path in sorted(folder.glob(f'{kind}/*.{kind}'))]
    return '\n\n'.join(_definition(path) for path in paths)


def _definition(path):
    lines = path.read_text(encoding='utf-8').splitlines()
    comments = [line[1:].strip() for line in lines if line.startswith('#')]
    about = ' '.join(text for text in comments if not text.startswith('status:'))
    parts = iter(PARTS[path.suffix])
    rows = [(next(parts), '', '') if line == '---' else _field(line)
            for line in lines if line and not line.startswith('#')]
    return f'### {path.stem}\n\n{about}\n\n' + _table(('field', 'type', 'meaning'), rows)


def _field(line):
    """('`name`', '`type`', meaning) of a line."""
    kind, name, value, text = FIELD.fullmatch(line.strip()).groups()
    return f'`{name}{value or ""}`', f'`{kind}`', text or ''


def _table(head, rows):
    lines = ['| ' + ' | '.join(head) + ' |', '|---' * len(head) + '|']
    return '\n'.join([*lines, *('| ' + ' | '.join(map(_cell, row)) + ' |' for row in rows)])


def _cell(text):
    return str(text).replace('|', '\\|')
