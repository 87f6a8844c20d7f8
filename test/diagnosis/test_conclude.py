"""Where something is left that nothing explains."""

from types import SimpleNamespace

import numpy as np

from arm_brachy.diagnosis.conclude import unexplained
from arm_brachy.diagnosis.observables import Row

MARKERS, ROWS = ('left', 'right', 'top'), 60


def test_only_markers_that_show_more_than_noise_say_where(monkeypatch):
    """A force alone is off: markers at their noise are no place. One of them as well: it is."""
    monkeypatch.setattr('arm_brachy.diagnosis.conclude._times', lambda assembly, values: ())
    assembly, noise = made_up(), np.random.default_rng(3).normal(size=ROWS * len(MARKERS))
    places, _ = unexplained(assembly, 0, noise)
    assert [(p.stream, p.channel) for p in places] == [('force', 'pad_1')]
    loud = noise + 3.0 * (np.arange(len(noise)) < ROWS)
    _, around = unexplained(assembly, 0, loud)[0]
    assert np.allclose(around.position, (-0.05, 0.0, 0.02))


def test_a_channel_says_when_in_the_recordings_that_have_it(monkeypatch):
    monkeypatch.setattr('arm_brachy.diagnosis.conclude._times', lambda assembly, values: values)
    assembly = made_up()
    other = SimpleNamespace(r=np.zeros(5), observables=SimpleNamespace(
        rows=[Row('force', 'pad_1', axis=2, state=k) for k in range(5)]))
    assembly.matched = (*assembly.matched, other)
    _, when = unexplained(assembly, 0, np.ones(ROWS * len(MARKERS) + 5))
    assert not when[:-5].any() and np.all(when[-5:] == 1.0)


def made_up():
    """What `unexplained` reads of an assembly: three markers and the pad force that stands out."""
    rows = [Row('optical', name, axis=0, state=k) for name in MARKERS for k in range(ROWS)]
    at = ((-0.05, 0.0, 0.02), (0.05, 0.0, 0.02), (0.0, 0.0, 0.06))
    scene = SimpleNamespace(markers=[SimpleNamespace(name=n, position=x)
                                     for n, x in zip(MARKERS, at, strict=True)])
    model = SimpleNamespace(specimen=SimpleNamespace(scene=scene))
    matched = SimpleNamespace(observables=SimpleNamespace(rows=rows), r=np.zeros(len(rows)),
                              baseline=SimpleNamespace(model=model))
    return SimpleNamespace(matched=(matched,), tests=((('force', 'pad_1', 2), 'rest'),))
