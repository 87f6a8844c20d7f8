"""The answer for bodies without pads that were let go, in the form of all answers."""

from dataclasses import replace

from arm_brachy.core.random import stream
from arm_brachy.diagnosis.free_vibration.curves import free_curves, free_traces
from arm_brachy.diagnosis.free_vibration.pipeline import free_diagnosis_parts
from arm_brachy.diagnosis.progress import untold
from arm_brachy.diagnosis.report.answer import Diagnosis
from arm_brachy.diagnosis.report.figures import body_of
from arm_brachy.diagnosis.report.page import Shown
from arm_brachy.diagnosis.results.formatting import listed, spoken
from arm_brachy.diagnosis.results.parts import Recording
from arm_brachy.tissue.build import build_body


def free_answer(evidences, provenance, held_out=(), progress=untold, known=None):
    """Return (Diagnosis, page.Shown) of loading.Evidence for which `screening.is_free`.

    held_out : Evidence to test on, not looked at before;  progress : as in `progress`
    known : stages.Known that is kept up to date
    Raises what `pipeline.free_diagnosis_parts` raises.
    """
    parts = free_diagnosis_parts(evidences, held_out=held_out, progress=progress,
                                 rng=stream(provenance.seed, 'decision'), known=known)
    recordings = recordings_of(evidences, held_out)
    accepted = parts.decision.accepted
    found = Diagnosis(
        parts.verdict, replace(provenance, recordings=recordings), parts.causes,
        parts.where, parts.when, parts.alternatives, parts.fit, parts.next_experiment,
        parts.recalibrated, evidence=accepted and accepted.evidence, held_out=parts.held_out,
        chance=parts.chance, apart=parts.apart, findings=parts.findings, notes=parts.notes,
        limits=parts.limits)
    scene = evidences[0].scene
    label = listed([spoken(cause.term) for cause in found.likeliest()]) if parts.causes else ''
    return found, Shown(body_of(scene, build_body(scene).mesh), free_traces(parts.paths),
                        curves=free_curves(parts.paths, label))


def recordings_of(evidences, held_out):
    """statements.Recording of each loading.Evidence."""
    return tuple(Recording(e.name, role, *map(float, e.span)) for group, role in (
        (evidences, 'fitted'), (held_out, 'held out')) for e in group)
