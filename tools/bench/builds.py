"""Where the builds are that tools/perf measures, and the history it keeps."""
import datetime
import json
import os
import re
import subprocess

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
HISTORY = os.path.join(ROOT, "golden/performance")
OWN = os.path.join(ROOT, "build/release")
TARGETS = ["scene_bench", "engine_bench"]
ENVIRONMENT = dict(os.environ, OMP_NUM_THREADS="1", OMP_WAIT_POLICY="passive")


class Problem(Exception):
    """What is wrong, with the remedy; ends the program."""

    def __init__(self, text, code=2):
        super().__init__(text)
        self.code = code


def git(*arguments):
    done = subprocess.run(["git", "-C", ROOT, *arguments], capture_output=True, text=True)
    if done.returncode != 0:
        raise Problem("git %s: %s" % (" ".join(arguments), done.stderr.strip()))
    return done.stdout.strip()


def output_of(command, seconds=600):
    """Standard output of a program; a Problem if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=seconds)
    except FileNotFoundError:
        raise Problem("%s is missing; run tools/build" % command[0], 3)
    if done.returncode != 0:
        raise Problem("%s: exit code %d\n%s" % (" ".join(command), done.returncode, done.stderr.strip()), 3)
    return done.stdout


def build(source, folder=None):
    """Configures and builds the benchmarks of the sources in `source`; returns the folder of the programs."""
    folder = folder or os.path.join(source, "build/release")
    log = os.path.join(os.path.dirname(folder), "build.log")
    os.makedirs(os.path.dirname(folder), exist_ok=True)
    with open(log, "w") as out:
        for command in (["cmake", "-S", source, "-B", folder, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release"],
                        ["cmake", "--build", folder, "--target", *TARGETS]):
            if subprocess.run(command, stdout=out, stderr=subprocess.STDOUT).returncode != 0:
                raise Problem("%s could not be built (%s); a commit before the benchmarks cannot be compared" %
                              (source, log), 3)
    return os.path.join(folder, "tools")


def export(ref, folder):
    """The files of a commit, in a folder of their own."""
    os.makedirs(folder, exist_ok=True)
    archive = subprocess.Popen(["git", "-C", ROOT, "archive", ref], stdout=subprocess.PIPE)
    unpacked = subprocess.run(["tar", "-x", "-C", folder], stdin=archive.stdout)
    if archive.wait() != 0 or unpacked.returncode != 0:
        raise Problem("%s: its files could not be written to %s" % (ref, folder), 3)


def compiler():
    """Of the release build: a text that is the same where instruction counts are the same."""
    path = os.path.join(OWN, "CMakeFiles")
    for folder in sorted(os.listdir(path)) if os.path.isdir(path) else []:
        file = os.path.join(path, folder, "CMakeCXXCompiler.cmake")
        if os.path.exists(file):
            text = open(file).read()
            return " ".join(re.search(r'set\(%s "([^"]*)"' % name, text).group(1)
                            for name in ("CMAKE_CXX_COMPILER_ID", "CMAKE_CXX_COMPILER_VERSION"))
    raise Problem("%s is no build; run tools/build" % OWN, 3)


def processor():
    text = open("/proc/cpuinfo").read()
    found = re.search(r"model name\s*: (.*)", text)
    flags = re.search(r"flags\s*: (.*)", text).group(1).split()
    isa = "avx512" if "avx512dq" in flags else "avx2" if "avx2" in flags else "sse2"
    return "%s, %s, %d cores" % (found.group(1).strip() if found else "unknown processor", isa, os.cpu_count()), isa


def read_history(name):
    path = os.path.join(HISTORY, name + ".json")
    return json.load(open(path)) if os.path.exists(path) else []


def require_reason_and_commit(why):
    """An entry is of a commit: builds its programs."""
    if not why.strip():
        raise Problem("--why is empty; say what changed and why, for those who review it")
    if git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!golden"):
        raise Problem("the tree has changes that are not committed; an entry names a commit: commit first", 2)
    build(ROOT)


def add_to_history(name, why, entry):
    """Appends an entry with commit, day and reason."""
    whole = {"commit": git("rev-parse", "--short=12", "HEAD"), "day": datetime.date.today().isoformat(), "why": why}
    whole.update(entry)
    history = read_history(name) + [whole]
    path = os.path.join(HISTORY, name + ".json")
    os.makedirs(HISTORY, exist_ok=True)
    with open(path + ".part", "w") as out:
        out.write("[\n" + ",\n".join(json.dumps(one, indent=1) for one in history) + "\n]\n")
    os.replace(path + ".part", path)
    print("%s: entry %d, commit %s" % (os.path.relpath(path, ROOT), len(history), whole["commit"]))
