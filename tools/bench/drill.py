"""A drill for the drill's sake of tools/perf: one kernel made 10 % slower in a copy of the sources."""
import os

import compare
import counts
from builds import OWN, ROOT, Problem, build, export

FILE = "engine/solver/kernels.cpp"
# Every tenth chunk of rows is multiplied twice: the same results, a tenth more of work.
CHANGES = [
    ("for (int l = 0; l < rows; l += n) {\n        const V px",
     "const int extra = chunk % 10 == 0 ? rows : 0;\n      for (int twice = 0; twice < rows + extra; twice += n) {\n"
     "        const int l = twice % rows;\n        const V px"),
    ("sum.add(l, px * y[0]", "if (twice >= extra) sum.add(l, px * y[0]"),
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
