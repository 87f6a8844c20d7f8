"""The estimators of the inside that tables of chapters 4 and 5 compare: one line each."""

from collections.abc import Callable
from dataclasses import dataclass, field

from arm_brachy.estimation import open_loop, rigid


@dataclass(frozen=True)
class Entry:
    """An estimator in the tables.

    name : as in the table's rows;  build : (scene, terms, targets, markers, params) -> Estimator
    params : given to build; None = its defaults
    noisy : False where what it says does not depend on the markers: one seed then serves for all
    thesis : number of markers -> mean target error that the thesis prints [mm]
    """

    name: str
    build: Callable
    params: object = None
    noisy: bool = True
    thesis: dict = field(default_factory=dict)


OPEN_LOOP = Entry('open_loop', open_loop.build, noisy=False, thesis={19: 1.7, 10: 1.7})
ESTIMATORS = (
    OPEN_LOOP,
    Entry('rigid', rigid.build),
)


def entry(name):
    """The Entry called `name`; KeyError if there is none."""
    return {one.name: one for one in ESTIMATORS}[name]
