"""Writes docs/accuracy.md from what studies left in a folder: `python tools/accuracy.py out/studies`.

Each study's folder holds NAME.md with its text and figures, and its plots. Plots are made small enough for
the repository and go to docs/images.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parents[1] / "docs"
LARGEST_BYTES = 300_000
HEAD = """# Accuracy

What the program's own studies found. Each one repeats an experiment with rendered images, or with numbers
that stand for them, and compares what comes out with the truth, which only the scoring sees. A goal that is
missed says **no**.

Each text says how many repetitions stand behind it; few mean that the study was run with `--quick`.

`make studies` runs them all in full and writes this page. One alone, and the page from what is there:

```
.venv/bin/truewheel study NAME --out out/studies/NAME
.venv/bin/python tools/accuracy.py out/studies
```

"""


def main(folder: Path) -> int:
    """Collect the studies of a folder; returns the exit status."""
    texts = sorted(path for path in folder.glob("*/*.md") if path.stem == path.parent.name)
    if not texts:
        sys.stderr.write(f"{folder}: expected studies, NAME/NAME.md, found none; run `make studies` first\n")
        return 2
    parts = [section(path) for path in texts]
    (DOCS / "accuracy.md").write_text(HEAD + "\n".join(parts), encoding="utf-8")
    sys.stdout.write(f"wrote {DOCS / 'accuracy.md'}: {', '.join(path.stem for path in texts)}\n")
    return 0


def section(path: Path) -> str:
    """Text of one study as a section of the page; its plots are copied."""
    text = re.sub(r"^# ", "## ", path.read_text(encoding="utf-8"), count=1)

    def placed(match: re.Match[str]) -> str:
        source = path.parent / match[2]
        target = DOCS / "images" / f"accuracy-{source.name}"
        save_small(source, target)
        return f"![{match[1]}](images/{target.name})"

    return re.sub(r"!\[([^\]]*)\]\(([^)]+)\)", placed, text)


def save_small(source: Path, target: Path) -> None:
    """Save a plot with at most 256 colours, and smaller until it is small enough."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(source) as opened:
        image = opened.convert("RGB")
    while True:
        image.quantize(256).save(target, optimize=True)
        if target.stat().st_size < LARGEST_BYTES:
            return
        image = image.resize((image.width * 3 // 4, image.height * 3 // 4))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/studies")))
