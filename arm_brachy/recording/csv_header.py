"""The names of a table's columns, of one line or of several.

A column is called by its own name, and where names stand above it, or a tool's word before it, by
both: `m1 X`, `m1X`. A name that several columns have is refused only where it is asked for.
Test: recording/test_csv_layout.py
"""

import difflib
import re
import string
from dataclasses import dataclass

from arm_brachy.core.errors import RecordingError
from arm_brachy.recording.csv_layout import filled

FEW = 12    # columns, to be named all


@dataclass(frozen=True)
class Header:
    """path : of the file;  own : names in the header line

    owners : names above each column, the outermost first; () = none
    hint : what to do where a column is not there, '' = nothing is known
    """

    path: str
    own: tuple
    owners: tuple = ()
    hint: str = ''

    @property
    def forms(self):
        """All names of every column, a tuple for each way of naming them."""
        if not any(self.owners):
            return (self.own,)
        return (self.own, *(tuple(joint.join([*some(above), own]) if own and above else own
                                  for own, above in zip(self.own, self.owners, strict=True))
                            for some, joint in ((_first, ''), (_first, ' '), (list, ' '))))

    def find(self, name):
        """Numbers of the columns of that name, which are several where it repeats."""
        for form in self.forms:
            found = [i for i, one in enumerate(form) if one == name]
            if found:
                return found
        raise RecordingError(f'{self.path}: no column {name!r}; {self._offered(name)}')

    def keys(self, pattern, axes, without=()):
        """What {key} of a pattern stands for in these names; RecordingError if in none.

        without : names of columns that are none of them, such as that of the times
        """
        axis = '(?:' + '|'.join(re.escape(a) for a in axes) + ')'
        groups = {'key': '(?P<key>.+?)', 'axis': axis, None: ''}
        form = re.compile(''.join(re.escape(text) + groups[name]
                                  for text, name, *_ in string.Formatter().parse(pattern)))
        for names in self.forms:
            found = [m.group('key') for m in map(form.fullmatch, names)
                     if m and m.group() not in without]
            if found:
                return tuple(dict.fromkeys(found))
        raise RecordingError(f'{self.path}: no column has the form {pattern!r}; {self._listed}')

    def repeats(self, name, found):
        """RecordingError for a name that several columns have which are not the same."""
        places = ' and '.join(str(i + 1) for i in found[:3])
        return RecordingError(
            f'{self.path}: column {name!r} is there {len(found)} times, as columns {places}, with '
            'different values; must be once: say in which lines above it the names are '
            '(`name_lines`), or rename one')

    def _offered(self, name):
        """What the header has, of long ones what is spelt nearly so."""
        names = dict.fromkeys(name for form in self.forms for name in form if name)
        near = difflib.get_close_matches(name, names, n=3)
        if near and len(names) > FEW:
            return f'did you mean {" or ".join(map(repr, near))}? ({len(self.own)} columns)'
        return self._listed

    @property
    def _listed(self):
        names = self.forms[min(2, len(self.forms) - 1)]
        more = len(names) - FEW
        return (f'the header has: {", ".join(names[:FEW])}' + (f' and {more} more' if more > 0
                                                               else '') + self.hint)


def owners_above(rows, count):
    """Names above `count` columns from rows of cells, the outermost first: a tuple for each."""
    rows = [filled(row)[:count] for row in rows]
    rows = [row + [row[-1] if row else ''] * (count - len(row)) for row in rows]
    return tuple(tuple(row[i] for row in rows if row[i]) for i in range(count))


def owners_before(own, word):
    """Tools whose columns follow the cells that begin with a word; names that a tool has twice
    are numbered: State, State 2. Returns (own names, owners).
    """
    tool, seen, names, owners = '', {}, [], []
    for cell in own:
        if cell.startswith(word):
            tool, seen = _tool_name(cell), {}
            names.append(word)
            owners.append((tool,))
            continue
        seen[cell] = seen.get(cell, 0) + 1
        names.append(cell if seen[cell] == 1 or not tool else f'{cell} {seen[cell]}')
        owners.append((tool,) if tool else ())
    return tuple(names), tuple(owners)


def _tool_name(cell):
    """`Port 10: gel_1  s/n:3E4C` -> gel_1; `Port 1` -> Port_1."""
    named = re.match(r'[^:]*:\s*(.*?)\s*(?:s/n.*)?$', cell)
    return re.sub(r'\W+', '_', (named and named.group(1)) or cell).strip('_')


def _first(above):
    return list(above[:1])
