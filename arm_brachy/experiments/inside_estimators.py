"""The estimators of the inside that tables of chapters 4 and 5 compare: one line each."""

from collections.abc import Callable
from dataclasses import dataclass, field

from arm_brachy.estimation import kf_admm, open_loop, rigid
from arm_brachy.estimation.kf_admm import KfAdmmParams


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


KF_ADMM = {19: 0.8, 10: 1.1}   # mm, thesis sec. 4.4.2
OPEN_LOOP = Entry('open_loop', open_loop.build, noisy=False, thesis={19: 1.7, 10: 1.7})
ESTIMATORS = (
    OPEN_LOOP,
    Entry('rigid', rigid.build),
    Entry('kf_admm', kf_admm.build, thesis=KF_ADMM),
    Entry('kf_admm_white', kf_admm.build, KfAdmmParams(process='white'), thesis=KF_ADMM),
)


def entry(name):
    """The Entry called `name`; KeyError if there is none."""
    return {one.name: one for one in ESTIMATORS}[name]
