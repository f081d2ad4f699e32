"""Thousands of damaged model files: each must give a model or a ModelError within ten seconds, and no other error.

    python tests/campaigns/mutated_models.py 0:200000 --results /tmp/mutated --jobs 2

Seeds are taken in chunks, and each finished chunk is a file in the results folder: what was interrupted goes on where it
stopped, and several runs (or machines) may share the seeds. Every failure is kept with its text, the slowest loads too; the exit
code is 1 if there is any failure. ``--show SEED`` prints a text and what becomes of it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import resource
import sys
from collections import Counter
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from model_mutations import judge, mutated  # noqa: E402

CHUNK = 1000
MEMORY = 4 * 2**30
SLOWEST = 5


def state_of_the_code() -> str:
    """A digest of the loader and of the mutations; results from another state of the code are not reused."""
    digest = hashlib.sha256()
    for path in sorted([*(ROOT / "codegen" / "model").rglob("*.py"), ROOT / "tests" / "model_mutations.py"]):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def run_chunk(job: tuple[int, int, Path, float, str]) -> dict[str, Any]:
    """Load the texts of the seeds ``start <= seed < stop``, and record the outcome of each."""
    start, stop, file, limit, code = job
    counts: Counter[str] = Counter()
    failures, slow = [], []
    total = 0.0
    for seed in range(start, stop):
        text = mutated(seed)
        verdict = judge(text, limit)
        counts[verdict.kind] += 1
        total += verdict.seconds
        slow.append((verdict.seconds, seed, len(text)))
        slow = sorted(slow, reverse=True)[:SLOWEST]
        if verdict.kind == "failed":
            failures.append({"seed": seed, "why": verdict.why, "seconds": verdict.seconds, "text": text})
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    result = {
        "start": start, "stop": stop, "code": code, "counts": counts, "seconds": total,
        "slowest": slow, "failures": failures, "peak_mb": peak,
    }  # fmt: skip
    temporary = file.with_suffix(".part")
    temporary.write_text(json.dumps(result, indent=1), encoding="utf-8")
    temporary.replace(file)
    return result


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("seeds", nargs="?", default="0:200000", help="FIRST:LAST, the last one left out")
    parser.add_argument("--results", type=Path, default=Path("mutated_models"), metavar="DIR")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--limit", type=float, default=10.0, help="seconds of the processor that a text may take")
    parser.add_argument("--show", type=int, metavar="SEED")
    options = parser.parse_args()
    if options.show is not None:
        text = mutated(options.show)
        print(text, judge(text, options.limit), sep="\n")
        return 0
    first, last = map(int, options.seeds.split(":"))
    options.results.mkdir(parents=True, exist_ok=True)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    code = state_of_the_code()
    jobs, done = [], []
    for start in range(first, last, CHUNK):
        stop = min(start + CHUNK, last)
        file = options.results / f"{start:09}-{stop:09}.json"
        if file.exists() and (found := json.loads(file.read_text(encoding="utf-8")))["code"] == code:
            done.append(found)
        else:
            jobs.append((start, stop, file, options.limit, code))
    with multiprocessing.Pool(options.jobs) as pool:
        for result in pool.imap(run_chunk, jobs):
            done.append(result)
            said = ", ".join(f"{n} {k}" for k, n in sorted(result["counts"].items()))
            print(f"{result['start']}:{result['stop']}  {said}; slowest {result['slowest'][0][0]:.2f} s", flush=True)
    return summary(done, code)


def summary(done: list[dict[str, Any]], code: str) -> int:
    """Print the outcomes of all seeds; returns 1 if any failed."""
    counts: Counter[str] = sum((Counter(r["counts"]) for r in done), Counter())
    failures = [f for r in done for f in r["failures"]]
    slowest = sorted((tuple(s) for r in done for s in r["slowest"]), reverse=True)[:SLOWEST]
    seconds = sum(r["seconds"] for r in done)
    print(
        f"{sum(counts.values())} texts, {dict(sorted(counts.items()))}; {seconds:.0f} s in all; loader and mutations {code}"
    )
    print("slowest: " + ", ".join(f"{s:.2f} s (seed {seed}, {size} bytes)" for s, seed, size in slowest))
    print(f"largest process: {max((r['peak_mb'] for r in done), default=0)} MB")
    classes: dict[str, list[int]] = {}
    for f in failures:
        classes.setdefault(f["why"][:100], []).append(f["seed"])
    for why, seeds in sorted(classes.items(), key=lambda c: -len(c[1])):
        print(f"{len(seeds):6}  {why}  (seeds {', '.join(map(str, seeds[:5]))})")
    return 1 if failures else 0


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
