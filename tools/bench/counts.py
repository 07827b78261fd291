"""Instruction counts (callgrind) of kernels and of whole short scenarios, and counts of work.

One thread and the kernels for AVX2, which callgrind can run, so that a count is the same on every processor that has
AVX2. Another compiler gives other counts: an entry names the compiler, and a build by another one is not compared.
"""
import json
import os
import re
import shutil
import tempfile

from builds import (OWN, Problem, add_to_history, compiler, output_of, processor, read_history,
                    require_reason_and_commit)

MOST_RISE = 0.03
# Steps enough to touch, to tear, to let go.
SCENARIOS = {
    "cylinder_retraction": 200,
    "fracture_pull_hinges": 60,
    "blunt_dissection": 25,
    "cube_sphere_b": 120,
    "brain_sylvian_retraction": 40,
}
# Functions of the engine, with all that they call.
FUNCTIONS = ["make_scene", "build_embedding", "build_distance_field", "step", "find_contacts", "assemble_elements",
             "close_rows", "assemble_contacts", "set_up_levels", "conjugate_gradients", "multiply",
             "advance", "advance_packing", "tear"]
NAME = re.compile(r"^\s*([\d,]+) \(\s*[\d.]+%\)\s+\S*?:(?:.*? )??sulcus::(?:isa_\w+::)?(?:\(anonymous namespace\)::)?"
                  r"(\w+)(?:<\w+>)?\(")


def functions_of(profile):
    """Instructions of each tracked function, what it calls included."""
    found = {}
    for line in output_of(["callgrind_annotate", "--inclusive=yes", "--threshold=100", profile]).splitlines():
        match = NAME.match(line)
        if match and match.group(2) in FUNCTIONS and "[clone" not in line:
            # of overloads and wrappers the outermost, which is listed first
            found.setdefault(match.group(2), int(match.group(1).replace(",", "")))
    return found


def count(scenario, steps, programs=os.path.join(OWN, "tools")):
    """{"instructions": {function: number}, "work": {name: number}} of a scenario's first steps."""
    if not shutil.which("valgrind"):
        raise Problem("valgrind is missing; run tools/setup", 3)
    with tempfile.TemporaryDirectory() as folder:
        profile = os.path.join(folder, "profile")
        result = json.loads(output_of(["valgrind", "-q", "--tool=callgrind", "--callgrind-out-file=" + profile,
                                       os.path.join(programs, "scene_bench"), scenario, "--steps", str(steps),
                                       "--isa", "avx2"]))
        return {"instructions": functions_of(profile), "work": result["work"]}


def count_all(programs=os.path.join(OWN, "tools")):
    if processor()[1] == "sse2":
        raise Problem("this processor has no AVX2, by whose kernels the counts are", 77)
    return {scenario: count(scenario, steps, programs) for scenario, steps in SCENARIOS.items()}


def compare(old, new):
    """(comparisons, rows that rose too much, rows that fell as much); a row: (name, old, new, relative change)."""
    compared, risen, fallen = 0, [], []
    for scenario in sorted(set(old) | set(new)):
        for kind in ("instructions", "work"):
            before, now = (side.get(scenario, {}).get(kind, {}) for side in (old, new))
            for name in sorted(set(before) | set(now)):
                compared += 1
                if name not in before or name not in now:
                    risen.append(("%s: %s" % (scenario, name), before.get(name), now.get(name), float("nan")))
                    continue
                change = now[name] / before[name] - 1 if before[name] else float(now[name] > 0)
                if abs(change) > MOST_RISE:
                    row = ("%s: %s" % (scenario, name), before[name], now[name], change)
                    (risen if change > 0 else fallen).append(row)
    return compared, risen, fallen


def check(programs=os.path.join(OWN, "tools")):
    history = read_history("counts")
    if not history:
        raise Problem("golden/performance/counts.json is missing or empty: nothing to compare with", 1)
    golden = history[-1]
    if golden["compiler"] != compiler():
        raise Problem("counts are of %s, this build is of %s: not comparable" % (golden["compiler"], compiler()), 77)
    compared, risen, fallen = compare(golden["counts"], count_all(programs))
    for text, rows in (("MORE", risen), ("less", fallen)):
        for name, before, now, change in rows:
            print("%s  %-50s %s -> %s  (%+.1f %%)" % (text, name, before, now, 100 * change))
    if compared == 0:
        raise Problem("nothing was compared", 1)
    print("counts: %d compared with those of %s (%s), %d rose by more than %.0f %%, %d fell as much" %
          (compared, golden["commit"], golden["day"], len(risen), 100 * MOST_RISE, len(fallen)))
    if risen:
        print('If it is meant: commit, then tools/perf bless --why "what costs more, and what it buys"')
    elif fallen:
        print('So that it stays: commit, then tools/perf bless --why "what made it cheaper"')
    return 1 if risen else 0


def bless(why):
    require_reason_and_commit(why)
    counted = count_all()
    history = read_history("counts")
    if history:
        for name, before, now, change in sum(compare(history[-1]["counts"], counted)[1:], []):
            print("%-50s %s -> %s  (%+.1f %%)" % (name, before, now, 100 * change))
    add_to_history("counts", why, {"compiler": compiler(), "counts": counted})
    return 0
