"""Every kernel as a share of what the machine can do, with the error beside it: engine_bench as Markdown tables."""
import json
import os
import re
import subprocess

from builds import OWN, Problem, git, processor

KERNELS = "rotations|assembly|product|iteration|solve"
BODIES = "cubes_5x5x8|cubes_14x14x20|cubes_24x24x24|cubes_40x50x50|jhu189_10mm"
HEAD = """# Roofline: every kernel as a share of what the machine can do

Made by `tools/perf roofline --page docs/roofline.md`. What the machine can read and compute is measured in the same process
first; a kernel's share is the time that its bytes or operations take at that rate, over the time it took. Above 100 %% the data
came from a nearer cache than the one that it was counted for.

%s, commit %s, load %.1f when it began (2 would be all cores busy; other programs make shares smaller and times longer, most of all with two threads,
which wait for each other: a row of two threads that takes longer than its row of one was met by them).

"""


def name_of(row):
    return re.match(r"(\w+)<(\w+)>/(\w+)/(\d)", row["name"]).groups()


def sizes(rows):
    """Cost and memory against size, of iterations and of whole solves."""
    yield "## Against size\n"
    yield "| body | tetrahedra | precision | threads | iteration [us] | for 1,000 [us] | solve [ms] | iterations | memory [MB] | for 1,000 [kB] |"
    yield "| --- | ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"
    times = {name_of(row)[1:]: row["best_us"] for row in rows if name_of(row)[0] == "iteration"}
    solves = [row for row in rows if name_of(row)[0] == "solve" and name_of(row)[1:] in times]
    for row in sorted(solves, key=lambda r: (r["tets"], name_of(r))):
        _, precision, body, threads = name_of(row)
        thousands, time = row["tets"] / 1000, times[precision, body, threads]
        yield "| %s | %s | %s | %s | %.1f | %.2f | %.2f | %d | %.1f | %.0f |" % (
            body, format(int(row["tets"]), ","), precision, threads, time, time / thousands, row["best_us"] / 1000,
            row["iterations"], row["MB"], 1000 * row["MB"] / thousands)


def kernels(rows):
    yield "## Share of the limit\n"
    yield "| kernel | precision | body | threads | time [us] | share | bound by | error |"
    yield "| --- | --- | --- | ---: | ---: | ---: | --- | ---: |"
    for row in rows:
        yield "| %s | %s | %s | %s | %.1f | %s | %s | %s |" % (
            *name_of(row), row["best_us"], "%.0f %%" % (100 * row["share"]) if row.get("label") else "",
            row.get("label", ""), "%.1e" % row["error"] if "error" in row else "")


def table(chosen, page=None):
    load = os.getloadavg()[0]
    program = os.path.join(OWN, "tools/engine_bench")
    done = subprocess.run([program, "--benchmark_filter=" + (chosen or "^(%s)<.*/(%s)/" % (KERNELS, BODIES)),
                           "--benchmark_format=json", "--benchmark_min_time=0.2"], capture_output=True, text=True)
    if done.returncode != 0 or not done.stdout.strip():
        raise Problem("%s: exit code %d\n%s" % (program, done.returncode, done.stderr), 3)
    rows = [row for row in json.loads(done.stdout)["benchmarks"] if not row.get("error_occurred")]
    if not rows:
        raise Problem("no kernel fits the filter", 2)
    text = HEAD % (processor()[0], git("rev-parse", "--short=12", "HEAD"), load)
    text += "".join("- %s\n" % line for line in done.stderr.splitlines() if "thread" in line and "GB/s" in line)
    text += "\n" + "\n".join([*sizes(rows), "", *kernels(rows)]) + "\n"
    if page is None:
        print(text, end="")
        return 0
    with open(page + ".part", "w") as out:
        out.write(text)
    os.replace(page + ".part", page)
    print(page)
    return 0
