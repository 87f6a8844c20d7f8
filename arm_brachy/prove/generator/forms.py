"""Every law that an effect of the catalogue can be planted with."""
from dataclasses import replace

from arm_brachy.prove.generator.form import REGISTRY
from arm_brachy.prove.generator.other_actuation import OTHER_ACTUATION
from arm_brachy.prove.generator.other_boundary import OTHER_BOUNDARY
from arm_brachy.prove.generator.other_sensing import OTHER_SENSING
from arm_brachy.prove.generator.other_tissue import OTHER_MEMORY, OTHER_TISSUE

# Name of an effect -> name of a form -> `Form`.
OTHER = {**OTHER_ACTUATION, **OTHER_SENSING, **OTHER_TISSUE, **OTHER_MEMORY, **OTHER_BOUNDARY}


def act_of(effect, own):
    """The function that plays `effect`; own: name -> function, for the registry's form."""
    if effect.form == REGISTRY:
        return own[effect.name]
    return OTHER[effect.name][effect.form].act


def in_some_form(rng, effect):
    """`effect` by the registry's law or, as often, by one of the others."""
    others = sorted(OTHER[effect.name])
    chosen = others[int(rng.integers(len(others)))]
    return effect if rng.random() < 0.5 else replace(effect, form=chosen)


def same_values(effect):
    """Names of the values of `effect` that mean what they mean in the registry."""
    if effect.form == REGISTRY:
        return tuple(effect.values)
    return OTHER[effect.name][effect.form].same
