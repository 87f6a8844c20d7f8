"""One diagnosis of a study: timed, and kept as a file, so that a study goes on where it was.

Test: experiments/gel_block/test_study.py, experiments/test_dome_faults.py
"""

import json
import os
import time

from arm_brachy.core.errors import ArmBrachyError
from arm_brachy.core.paths import share_dir
from arm_brachy.diagnosis.pipeline import diagnose
from arm_brachy.diagnosis.report.answer import Provenance
from arm_brachy.diagnosis.report.page import write_diagnosis
from arm_brachy.evaluation.result import commit_of, machine_description


def keep(path, ask):
    """Write {'cpu_s', 'answer'} to `path`, whole or not at all.

    ask : () -> answer as JSON holds it; an ArmBrachyError of it is kept as {'error': text}
    cpu_s : CPU time [s] of this process meanwhile
    """
    start = time.process_time()
    try:
        answer = ask()
    except ArmBrachyError as error:
        answer = {'error': str(error)}
    part = path.with_suffix('.part')
    part.write_text(json.dumps({'cpu_s': time.process_time() - start, 'answer': answer}),
                    encoding='utf-8')
    os.replace(part, path)


def diagnosed(evidences, name, scene, page, *, seed, held_out=()):
    """The answer of the diagnosis as JSON holds it; its page is written to `page`.

    evidences, held_out : loading.Evidence;  name, scene : of what is shown, in words
    """
    source = Provenance(name, seed, commit_of(share_dir()), str(machine_description()), scene, ())
    answer = diagnose(evidences, source, held_out=held_out)
    write_diagnosis(answer.diagnosis, answer.shown, page)
    return json.loads(answer.diagnosis.to_json())
