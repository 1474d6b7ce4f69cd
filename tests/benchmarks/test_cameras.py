import pytest

pytest.importorskip("pypylon.pylon", reason="pypylon is not installed: pip install 'truewheel[pylon]'")

from benchmarks.cameras import MOST_MS, SIZES, compare


@pytest.mark.slow
def test_from_trigger_to_six_images_the_program_adds_little_to_the_library() -> None:
    figures = compare(SIZES["1280x1024"], "Mono8", 30)
    assert figures["overhead_p95_ms"] <= MOST_MS
