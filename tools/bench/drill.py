"""A drill for the drill's sake of tools/perf: one kernel made 10 % slower in a copy of the sources."""
import os

import compare
import counts
from builds import OWN, ROOT, Problem, build, export

FILE = "engine/solver/kernels.cpp"
# The first tenth of the blocks is multiplied once more after all others, when it has left the nearer caches: the same
# results, a tenth more of time, whether the machine's memory or its arithmetic is the limit.
CHANGES = [
    ("for (std::int64_t block = first_block; block < last_block; ++block) {\n"
     "    for (std::int64_t chunk = block * chunks_per_block; chunk < last_chunk(block, a.chunks); ++chunk) {\n"
     "      const Real* own",
     "const std::int64_t again = (last_block - first_block + 9) / 10;\n"
     "  for (std::int64_t turn = first_block; turn < last_block + again; ++turn) {\n"
     "    const std::int64_t block = turn < last_block ? turn : first_block + turn - last_block;\n"
     "    for (std::int64_t chunk = block * chunks_per_block; chunk < last_chunk(block, a.chunks); ++chunk) {\n"
     "      const Real* own"),
]


def run():
    source = os.path.join(ROOT, "build/perf/slow")
    export("HEAD", source)
    path = os.path.join(source, FILE)
    text = open(path).read()
    for old, new in CHANGES:
        if text.count(old) != 1:
            raise Problem("drill: its text occurs %d times in %s, expected once; bring tools/bench/drill.py up to date:"
                          "\n%s" % (text.count(old), FILE, old))
        text = text.replace(old, new)
    with open(path, "w") as changed:
        changed.write(text)
    slow = build(source)

    print("counters:")
    compared, risen, _ = counts.compare(counts.count_all(os.path.join(OWN, "tools")), counts.count_all(slow))
    for name, before, now, change in risen:
        print("MORE  %-50s %d -> %d  (%+.1f %%)" % (name, before, now, 100 * change))
    by_counts = any(name.endswith(": multiply") for name, *_ in risen)
    print("wall time:")
    found, _ = compare.alarms(compare.own_programs(), slow, compare.LEAST_REPETITIONS)
    by_time = any(name.startswith("product") for name in found)
    for name in found:
        print("SLOWER  %s" % name)
    print("drill: the slower kernel was %s by counters (%d compared), %s by wall time" %
          ("caught" if by_counts else "MISSED", compared, "caught" if by_time else "MISSED"))
    return 0 if by_counts and by_time else 1
