"""The estimators of the inside that tables of chapters 4 and 5 compare: one line each."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from arm_brachy.core.scene import with_mesh
from arm_brachy.estimation import kf_admm, open_loop, pod, rigid
from arm_brachy.estimation import map as map_estimator
from arm_brachy.estimation.graph_vae import estimator as graph_vae
from arm_brachy.estimation.kf_admm import KfAdmmParams
from arm_brachy.estimation.map import MapParams
from arm_brachy.estimation.pod_params import PodParams

RIMS = 'breast_rims_800.msh'    # beside the model's mesh, with the rims of the pads as edges


@dataclass(frozen=True)
class Entry:
    """An estimator in the tables.

    name : as in the table's rows;  build : (scene, terms, targets, markers, params) -> Estimator
    params : given to build; None = its defaults
    noisy : False where what it says does not depend on the markers: one seed then serves for all
    memory : False where an estimate depends on its Surface alone: it is then asked at the end of
        every hold only, all seeds at one travel after each other
    thesis : number of markers -> mean target error that the thesis prints [mm]
    """

    name: str
    build: Callable
    params: object = None
    noisy: bool = True
    memory: bool = True
    thesis: dict = field(default_factory=dict)


def on_mesh(name, build):
    """Return `build` on another mesh than the model's: what the mesh alone is worth.

    name : file beside the model's
    """
    def built(scene, *arguments):
        return build(with_mesh(scene, Path(scene.mesh.file).parent / name), *arguments)
    return built


KF_ADMM = {19: 0.8, 10: 1.1}   # mm, thesis sec. 4.4.2
OPEN_LOOP = Entry('open_loop', open_loop.build, noisy=False, memory=False,
                   thesis={19: 1.7, 10: 1.7})
ESTIMATORS = (
    OPEN_LOOP,
    Entry('rigid', rigid.build),
    Entry('kf_admm', kf_admm.build, thesis=KF_ADMM),
    Entry('kf_admm_white', kf_admm.build, KfAdmmParams(process='white'), thesis=KF_ADMM),
    Entry('pod', pod.build, memory=False),
    Entry('pod_es_mda', pod.build, PodParams(update='es_mda'), memory=False),
    Entry('graph_vae', graph_vae.build, memory=False),
    Entry('map', map_estimator.build, MapParams(mesh=RIMS), memory=False),
    # not on the model's mesh but on that of `map`
    Entry('open_loop_rims', on_mesh(RIMS, open_loop.build), noisy=False, memory=False),
    Entry('pod_rims', on_mesh(RIMS, pod.build), memory=False),
)


def entry(name):
    """The Entry called `name`; KeyError if there is none."""
    return {one.name: one for one in ESTIMATORS}[name]
