"""Every kernel as a share of what the machine can do, with the error beside it: engine_bench as a Markdown table."""
import json
import os
import re
import subprocess

from builds import OWN, Problem, processor

KERNELS = "rotations|assembly|product|iteration|solve"
BODIES = "cubes_5x5x8|cubes_14x14x20|cubes_24x24x24|cubes_40x50x50|jhu189_10mm"


def table(chosen):
    program = os.path.join(OWN, "tools/engine_bench")
    done = subprocess.run([program, "--benchmark_filter=" + (chosen or "^(%s)<.*/(%s)/" % (KERNELS, BODIES)),
                           "--benchmark_format=json", "--benchmark_min_time=0.2"], capture_output=True, text=True)
    if done.returncode != 0 or not done.stdout.strip():
        raise Problem("%s: exit code %d\n%s" % (program, done.returncode, done.stderr), 3)
    print("%s. Limits, measured in the same process:\n" % processor()[0])
    print("".join("- %s\n" % line for line in done.stderr.splitlines() if "thread" in line and "GB/s" in line))
    print("| kernel | precision | body | threads | time [us] | share | bound by | error | memory [MB] |")
    print("| --- | --- | --- | ---: | ---: | ---: | --- | ---: | ---: |")
    rows = 0
    for row in json.loads(done.stdout)["benchmarks"]:
        if row.get("error_occurred"):
            continue
        kernel, precision, body, threads = re.match(r"(\w+)<(\w+)>/(\w+)/(\d)", row["name"]).groups()
        print("| %s | %s | %s | %s | %.1f | %s | %s | %s | %s |" % (
            kernel, precision, body, threads, row["best_us"],
            "%.0f %%" % (100 * row["share"]) if row.get("label") else "", row.get("label", ""),
            "%.1e" % row["error"] if "error" in row else "", "%.1f" % row["MB"] if "MB" in row else ""))
        rows += 1
    if rows == 0:
        raise Problem("no kernel fits the filter", 2)
    return 0
