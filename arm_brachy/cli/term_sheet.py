"""One physics term as lines that fit a wide terminal: what, equation, parameters, how to have it.

Test: test_cli.py
"""

import dataclasses
import io
import textwrap

import numpy as np
from ruamel.yaml import YAML

from arm_brachy import registry
from arm_brachy.core.quantity import UNITS, quantities
from arm_brachy.diagnosis.model.hypothesis import strengths
from arm_brachy.scenario import PADS_BY_NUMBER

WIDTH = 96
PRIORS = {'normal': 'normal, mean {:g}, standard deviation {:g}',
          'lognormal': 'lognormal, median {:g}, log standard deviation {:g}',
          'uniform': 'uniform, {:g} to {:g}'}


def term_sheet(name):
    """Return the text. Raises ConfigError with the nearest known name."""
    term = registry.by_name(name)
    spec = term.spec
    parts = [*textwrap.wrap(f'{spec.name}: {spec.summary} ({spec.kind.value})', WIDTH), '',
             *_named('equation', spec.equation), *_named('source', spec.source),
             *_named('invisible', spec.invisible_when or 'never, as far as is known'),
             *_named('left open', spec.leaves_open)]
    for field in dataclasses.fields(term):
        parts += _parameter(term, field)
    return '\n'.join([*parts, '', 'in a scenario, under `plant` or `model`:', _entry(term)])


def _named(name, text, before=''):
    return textwrap.wrap(f'{before}{name:<10}  {text}', WIDTH, break_long_words=False,
                         subsequent_indent=before + 12 * ' ')


def _parameter(term, field):
    infos = quantities(term)
    if field.name not in infos:
        return ['', field.name, f'    default     {_default(field)}']
    info = infos[field.name]
    rows = {'allowed': info.allowed(), 'prior': _prior(info),
            'typical': _typical(term, field.name, info), 'source': info.source}
    lines = ['', f'{info.key(field.name)} [{UNITS[info.unit][1]}]', *_indented(info.text)]
    for name, text in rows.items():
        if text:
            lines += _named(name, text, before='    ')
    return lines


def _default(field):
    """The default of a choice: of names, of numbers, of one of several words."""
    if field.name in PADS_BY_NUMBER:
        none = 'all' if field.default == () else 'none in particular'
        return f'{none}; else names of pads, or their numbers, the first of the scene 0'
    return 'all' if field.default == () else field.default


def _indented(text):
    return textwrap.wrap(text, WIDTH, initial_indent='    ', subsequent_indent='    ')


def _prior(info):
    return '' if info.prior is None else PRIORS[info.prior[0]].format(*info.prior[1:])


def _typical(term, name, info):
    """What `diagnose` takes for its usual size; '' of what says where, when or how."""
    found = [one for one in strengths(term) if one.name == name]
    if not found:
        return ''
    off = f'{info.neutral:g}' if np.isfinite(info.neutral) else 'infinite'
    return f'{found[0].typical / info.scale:g}; none of it: {off}'


def present(term):
    """The term with its first strength at its typical size, all else at its defaults."""
    one = strengths(term)[0]
    size = one.typical
    if one.component is not None:
        size = tuple(size if i == one.component else one.neutral for i in range(3))
    return dataclasses.replace(term(), **{one.name: size})


def _entry(term):
    out, yaml = io.StringIO(), YAML()
    yaml.default_flow_style = None      # lists in a line, keys in lines of their own
    yaml.dump({'terms': registry.to_entries([present(term)])}, out)
    return textwrap.indent(out.getvalue().rstrip(), '    ')
