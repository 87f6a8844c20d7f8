"""The README says what the graph, the registry and the files in results/ say."""

from arm_brachy.core.paths import share_dir
from arm_brachy.experiments.readme import BUILDERS, SECTION, rendered


def test_every_section_is_up_to_date():
    text = (share_dir() / 'README.md').read_text(encoding='utf-8')
    assert {m[1] for m in SECTION.findall(text)} == set(BUILDERS)
    assert rendered(text, share_dir() / 'results') == text
