"""The generator as the trial sees it: what may be wished for, bodies, recordings with their truth.

Another generator is another module with WISHES, `prepare`, `make`, and Unmade, which these raise
for what they cannot make.
"""

import json
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from arm_brachy.experiments.diagnosis_score import INERT
from arm_brachy.prove import bridge
from arm_brachy.prove.generator.body import COARSE, SOLVERS, draw_body
from arm_brachy.prove.generator.case import TERMS, draw
from arm_brachy.prove.generator.make import known
from arm_brachy.prove.generator.make import make as record
from arm_brachy.prove.generator.response import refuse_apart
from arm_brachy.prove.generator.solver import NotSolved
from arm_brachy.prove.generator.strange import STRANGE as FAMILIES
from arm_brachy.prove.plan import CONFOUNDED, NULL, PAIR, SINGLE, STRANGE

# A lag before the encoders cannot be seen beside them; the rest of the catalogue can be.
VISIBLE = tuple(name for name in TERMS if name not in INERT)
JOINED = ('axis_crosstalk',)    # of them, those that no trial before wishes were kept had
# Seen by the markers on the pads alone, a step that a pad lost is a slip of its marker.
ALIKE = ('lost_steps', 'marker_slip')
WITHHELD = ('forces', 'em', 'tissue')
WISHES = {NULL: (), SINGLE: VISIBLE, PAIR: (), STRANGE: tuple(sorted(FAMILIES)),
          CONFOUNDED: ('lost_steps',)}
MESH = 'mesh.msh'
Unmade = NotSolved


def body_of(job):
    """The body of a case; bodies take the truth solvers in turn."""
    solvers = sorted(SOLVERS)
    return draw_body(job.body_rng(), f'body_{job.body}', solvers[job.body % len(solvers)])


def case_of(job):
    """The generator's Case of a job."""
    return draw(job.rng(), job.wish or job.kind, body_of(job), terms=VISIBLE)


def prepare(job, body_folder, cache):
    """Solve the unplanted body of a job into `cache`, and mesh it for the receiver.

    Raises Unmade where its two meshes part: then one of them is no truth.
    """
    body = body_of(job)
    refuse_apart(*(body.response(options, Path(cache))
                   for options in (SOLVERS[body.solver], COARSE)))
    bridge.mesh_body(_plain(known(body)), Path(body_folder) / MESH)


def make(job, folder, cache, body_folder, *, sound=False, again=False):
    """Write bag, scene and mesh of a job into `folder`; returns its truth (arrays in 'heldout').

    body_folder : that `prepare` filled;  sound : the same set-up without the effect
    again : the same once more, and nothing withheld
    Times of the truth are those of the generator, `start_s` before those of the bag.
    """
    case, confounded = case_of(job), job.kind == CONFOUNDED
    withheld = WITHHELD if confounded and not again else ()
    played = case.without_effect if sound else case.again if again else case
    with TemporaryDirectory(dir=cache) as csv:
        truth = record(played, Path(csv), Path(cache))
        bridge.write_bag(_plain(known(case.body)), csv, Path(folder) / 'bag', withheld=withheld)
    if not (sound or again):
        shutil.copyfile(Path(body_folder) / MESH, Path(folder) / MESH)
        bridge.write_scene(_plain(known(case.body)), MESH, Path(folder) / 'scene.yaml')
    return {**truth, 'withheld': list(withheld), 'alike': list(ALIKE if confounded else ()),
            'start_s': bridge.START, 'E_kPa': case.body.modulus / 1e3}


def _plain(body):
    """A description as it comes back from its file."""
    return json.loads(json.dumps(body))
