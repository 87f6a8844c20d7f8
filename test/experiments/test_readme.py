"""READMEs say what the graph, the registry and the files in results/ say."""

from arm_brachy.core.paths import share_dir
from arm_brachy.experiments.readme import BUILDERS, DOCUMENTS, SECTION, rendered


def test_every_section_is_up_to_date():
    texts = [(share_dir() / name).read_text(encoding='utf-8') for name in DOCUMENTS]
    assert sorted(m[1] for text in texts for m in SECTION.findall(text)) == sorted(BUILDERS)
    for text in texts:
        assert rendered(text, share_dir() / 'results') == text
