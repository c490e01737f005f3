"""Wall time and run counts of one study: python benchmarks/study_wall.py STUDY [arguments of rso run]

The results go to a temporary folder, so that nothing is taken from an earlier run (but for meshes in the user's cache).
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def main(arguments: list[str]) -> int:
    """The exit code of rso run."""
    if not arguments:
        print(__doc__.strip().splitlines()[0], file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "results"
        command = [sys.executable, "-c", "import sys; from rso.cli import main; sys.exit(main())", "run"]
        start = time.perf_counter()
        done = subprocess.run([*command, arguments[0], "--out", str(out), *arguments[1:]])
        wall = time.perf_counter() - start
        print(f"\nwall {wall:.1f} s, exit code {done.returncode}")
        results = out / "results.json"
        if results.exists():
            found = json.loads(results.read_text(encoding="utf-8"))
            for title in ("counts", "timings"):
                print(title, ", ".join(f"{k} {v:.4g}" for k, v in found[title].items()))
        return done.returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
