"""Which pads of a body a term acts on."""

from arm_brachy.core.errors import ConfigError


def chosen_pads(body, names, term):
    """Return the indices into `body.pads` of those that a term acts on.

    body : SoftBody;  names : of pads; empty means all;  term : its name, for messages
    Raises ConfigError if the body has no such pad.
    """
    unknown = sorted(set(names) - set(body.pad_names))
    if unknown:
        raise ConfigError(f'{term}: pads = {list(names)}; {", ".join(unknown)} must be among '
                          f'{", ".join(body.pad_names)}')
    return [i for i, name in enumerate(body.pad_names) if not names or name in names]


def with_pad(body, i, pad):
    """Return the pads of a SoftBody with the i-th replaced."""
    return (*body.pads[:i], pad, *body.pads[i + 1:])
