"""What a person does after a diagnosis, whatever its verdict.

Test: diagnosis/test_next_steps.py
"""

from arm_brachy.core.term import Kind
from arm_brachy.diagnosis.report import sentences
from arm_brachy.diagnosis.results.formatting import STREAMS, listed, spoken
from arm_brachy.diagnosis.results.parts import SEEN
from arm_brachy.diagnosis.settings import Rules

NULL = ('Record the same protocol on a set-up in which nothing is wrong, and give it with --null: '
        'what both recordings show is then no fault.')
HELD_OUT = ('Confirm it on a recording that was not fitted: record the same set-up once more, '
            'moved in another way, and give that recording with --hold-out.')
FINER = ('Solve on a finer mesh: what this one may be wrong by is larger than the noise. '
         '`arm-brachy mesh SURFACE MESH --scene SCENE` makes one.')
AGAIN = {'quick': 'Run the whole diagnosis for a verdict: the same command without --quick.',
         'time_limit': 'Run the same command again for a verdict, with a longer --time-limit or '
                       'without one.',
         'interrupted': 'Run the same command again, to its end, for a verdict.'}


def what_next(d):
    """Sentences on what to do after Diagnosis `d`, the most useful first; at least one."""
    asked = [] if d.next_experiment is None else [sentences.request(d.next_experiment)]
    return (*asked, *{'named': _named, 'nothing_missing': _nothing, 'equivalent': _equivalent,
                      'unexplained': _unexplained, 'partial': _partial}[d.verdict](d))


def _named(d):
    physical = [cause for cause in d.causes if cause.physical]
    if not physical:
        yield FINER
        return
    devices = [spoken(cause.term) for cause in physical
               if cause.spec.kind in (Kind.ACTUATION, Kind.SENSING)]
    if devices:
        yield (f'Calibrate or repair what {listed(devices)} describes, then record again: the '
               'misfit should fall to the noise.')
    yield from _corrected(d)
    if not _held_out(d):
        yield HELD_OUT
    yield from _remaining(d)


def _nothing(d):
    yield from _corrected(d)
    if any(one.blurred for one in d.fit):
        yield FINER
    if d.limits:
        yield ('Compare the effect you expect with the table of detection limits below: what is '
               'smaller than listed there could not have been found in these recordings.')
    yield ('To find smaller effects, record deeper pushes, every pad alone, at two speeds a '
           'decade apart.')


def _equivalent(d):
    if d.next_experiment is None:
        yield ('Record what separates the candidates: every pad alone and in pairs, at two '
               'depths and two speeds, with all sensors.')
    yield from _corrected(d)


def _unexplained(d):
    if d.where or d.when:
        yield (f'Inspect the set-up first where the misfit is largest: {_most(d)}. Look for a '
               'loose marker, a cable or a hand on the body, a contact that is not in the scene.')
    if d.nearest is not None:
        names = listed([spoken(cause.term) for cause in d.nearest.causes])
        yield (f'Test {names} by itself, since it comes nearest: record a protocol that '
               'isolates it. It does not explain the whole misfit.')
    yield NULL
    yield ('If you know the effect and no term of `arm-brachy terms` describes it, add it as a '
           'term; the next diagnosis then tries it.')


def _partial(d):
    yield AGAIN[d.unfinished.why]
    if d.causes:
        names = listed([spoken(cause.term) for cause in d.causes])
        yield f'The signals alone show {names}: that can be calibrated or repaired already.'
    if d.screen and d.screen[0].evidence >= Rules().evidence:
        yield (f'Treat {spoken(d.screen[0].term)} as a candidate until then: no full fit has '
               'confirmed it.' if d.screen[0].full_fit is None else
               f'Treat {spoken(d.screen[0].term)} as a candidate until then: it has not been '
               'compared with all its rivals.')


def _corrected(d):
    if d.scene:
        yield (f'Run the corrected scenario, `arm-brachy run {d.scene}`, and compare the next '
               'recording with it.')


def _remaining(d):
    """What to do about a misfit that the named causes leave."""
    left = [one for one in d.fit if one.times_noise > SEEN]
    if not left:
        return
    streams = listed([STREAMS[one.stream][0] for one in left])
    if all(one.blurred for one in left):
        yield FINER
    else:
        yield (f'Something is left in the {streams}: check registration and meshes there before '
               'the corrected scenario is used where that accuracy matters. ' + NULL)


def _held_out(d):
    return any(one.role == 'held out' for one in d.provenance.recordings)


def _most(d):
    """The first place and the first time of what is unexplained."""
    parts = [sentences.place(next((one for one in d.where if not one.term), d.where[0]))
             ] if d.where else []
    if d.when:
        parts.append(sentences.interval(next((one for one in d.when if not one.term), d.when[0]),
                                    d.provenance.recordings))
    return ', '.join(parts)
