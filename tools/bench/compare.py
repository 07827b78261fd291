"""Wall time of two builds, in interleaved pairs on the same machine, one thread.

A measure is slower if its median is at least 5 % longer and the Mann-Whitney U test says so with p < 0.01, and if a
second run of as many pairs says the same again. Beside each time stands the error that it was bought with.
"""
import json
import os
import re
import statistics

from builds import (OWN, ROOT, TARGETS, Problem, add_to_history, build, export, git, output_of, processor,
                    require_reason_and_commit)

LEAST_REPETITIONS = 9
LEAST_EFFECT = 0.05
LEVEL = 0.01
SCENES = {"cylinder_retraction": 100, "fracture_pull_hinges": 60, "four_labels": 60}
KERNELS = "^(rotations|product|iteration)<single>/cubes_14x14x20/1/"


def sample(programs):
    """{measure: (time, error)}; times in ms of scenes, in us of kernels."""
    found = {}
    for scene, steps in SCENES.items():
        result = json.loads(output_of([os.path.join(programs, "scene_bench"), scene, "--steps", str(steps)]))
        found["%s, a step [ms]" % scene] = (result["step_ms"], result["residual"])
        found["%s, its scene [ms]" % scene] = (result["scene_ms"], None)
    text = output_of([os.path.join(programs, "engine_bench"), "--benchmark_filter=" + KERNELS,
                      "--benchmark_format=json", "--benchmark_min_time=0.05", "--without_limits"])
    if not text.strip():
        raise Problem("engine_bench of %s knows no kernel %s" % (programs, KERNELS), 1)
    for kernel in json.loads(text)["benchmarks"]:
        name = re.sub(r"/manual_time$", "", kernel["name"])
        found["%s [us]" % name] = (kernel["best_us"], kernel.get("error"))
    return found


def u_test(base, new):
    """Probability that samples of one distribution rank `new` as high above `base` or higher (exact, one-sided; a tie
    counts half, and half a rank is rounded towards no difference)."""
    above = sum((b < n) + 0.5 * (b == n) for n in new for b in base)
    # number of ways to get each U from m and n values: ways[i][j][u]
    m, n = len(new), len(base)
    ways = [[None] * (n + 1) for _ in range(m + 1)]
    for i in range(m + 1):
        for j in range(n + 1):
            if i == 0 or j == 0:
                ways[i][j] = [1]
                continue
            row = [0] * (i * j + 1)
            for u, count in enumerate(ways[i - 1][j]):  # the largest is one of the new
                row[u + j] += count
            for u, count in enumerate(ways[i][j - 1]):
                row[u] += count
            ways[i][j] = row
    return sum(ways[m][n][int(above):]) / sum(ways[m][n])


def pairs(base, new, repetitions):
    """{measure: (times of base, times of new, error of base, error of new)}; the two take turns in going first."""
    found = {}
    for repetition in range(repetitions):
        sides = {}
        for side in ("base", "new") if repetition % 2 == 0 else ("new", "base"):
            sides[side] = sample(base if side == "base" else new)
        for name in sides["base"].keys() & sides["new"].keys():
            times = found.setdefault(name, ([], [], sides["base"][name][1], sides["new"][name][1]))
            times[0].append(sides["base"][name][0])
            times[1].append(sides["new"][name][0])
    if not found:
        raise Problem("nothing was compared: the two builds have no measure in common", 1)
    return found


def effect(base, new):
    return statistics.median(new) / statistics.median(base) - 1


def slower(base, new):
    return effect(base, new) >= LEAST_EFFECT and u_test(base, new) < LEVEL


def print_table(found):
    print("%-48s %10s %10s %8s %10s  %s" % ("", "base", "new", "change", "p slower", "error left"))
    for name in sorted(found):
        base, new, base_error, new_error = found[name]
        errors = "" if new_error is None else "%.2g" % new_error
        if new_error != base_error:
            errors = "%s -> %s" % (base_error, new_error)
        print("%-48s %10.3f %10.3f %+7.1f%% %10.2g  %s" % (name, statistics.median(base), statistics.median(new),
                                                           100 * effect(base, new), u_test(base, new), errors))


def alarms(base, new, repetitions, quiet=False):
    """Measures that are slower in a first run and again in a second one; and the first run."""
    first = pairs(base, new, repetitions)
    if not quiet:
        print_table(first)
    suspects = [name for name in first if slower(*first[name][:2])]
    if not suspects:
        return [], first
    print("slower, to be confirmed: %s" % "; ".join(suspects), flush=True)
    second = pairs(base, new, repetitions)
    if not quiet:
        print_table(second)
    return sorted(name for name in suspects if name in second and slower(*second[name][:2])), first


def verdict(found, first):
    for name in found:
        print("SLOWER  %s" % name)
    print("compare: %d measures, %d slower" % (len(first), len(found)))
    return 1 if found else 0


def own_programs():
    programs = os.path.join(OWN, "tools")
    for target in TARGETS:
        if not os.path.exists(os.path.join(programs, target)):
            raise Problem("%s is not built; run tools/build %s" % (target, " ".join(TARGETS)), 3)
    return programs


def against(base_ref, repetitions):
    if repetitions < LEAST_REPETITIONS:
        raise Problem("--repetitions: found %d, expected %d at least" % (repetitions, LEAST_REPETITIONS))
    commit = git("rev-parse", "--verify", "--short=12", base_ref + "^{commit}")
    source = os.path.join(ROOT, "build/perf", commit)
    export(commit, source)
    print("building %s in %s" % (commit, os.path.relpath(source, ROOT)), flush=True)
    return verdict(*alarms(build(source), own_programs(), repetitions))


def noise(times):
    """The build against itself."""
    programs = own_programs()
    false_alarms, effects = 0, {}
    for number in range(times):
        found, first = alarms(programs, programs, LEAST_REPETITIONS, quiet=True)
        false_alarms += bool(found)
        for name, row in first.items():
            effects.setdefault(name, []).append(abs(effect(*row[:2])))
        print("%d of %d: %d false alarms so far" % (number + 1, times, false_alarms), flush=True)
    print("| measure | median difference | largest |\n| --- | ---: | ---: |")
    for name in sorted(effects):
        print("| %s | %.1f %% | %.1f %% |" %
              (name, 100 * statistics.median(effects[name]), 100 * max(effects[name])))
    print("noise: %d comparisons of %d measures each, %d false alarms" % (times, len(effects), false_alarms))
    return 1 if false_alarms or not effects else 0


def record(why):
    require_reason_and_commit(why)
    programs = own_programs()
    all_samples = [sample(programs) for _ in range(LEAST_REPETITIONS)]
    times = {name: {"median": statistics.median(s[name][0] for s in all_samples),
                    "spread": max(s[name][0] for s in all_samples) - min(s[name][0] for s in all_samples),
                    "error": all_samples[0][name][1]} for name in sorted(all_samples[0])}
    add_to_history("times", why, {"machine": processor()[0], "times": times})
    return 0
