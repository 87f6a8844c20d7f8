"""The law by which an effect acts: the registry's, or another that goes by the same name."""
from collections.abc import Callable
from dataclasses import dataclass

REGISTRY = 'registry'


@dataclass(frozen=True)
class Form:
    """A law of an effect that is not the registry's.

    act : a function of the signature that the functions of its family have;  same : the names of
    the effect's values that mean in it what they mean in the registry, to within a tenth
    """

    act: Callable
    same: tuple = ()
