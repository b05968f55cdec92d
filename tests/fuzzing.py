"""Runs commands one after the other in a process of its own, so that a signal or a hang ends this process and not the tests.

    python -m tests.fuzzing CASES FIRST

CASES is a JSON list of [folder, command words]. The status of each goes to standard output as a line, what the command says to
FOLDER/said.out and FOLDER/said.err. A command that takes longer than LIMIT ends the process by SIGALRM.
"""

import json
import os
import signal
import subprocess
import sys
import traceback
from pathlib import Path

LIMIT = 120  # [s]
ROOT = Path(__file__).parent.parent


def run_all(cases, file):
    """The status of each case: that of the command, or minus the number of the signal that it died of; 70 after a traceback."""
    file.write_text(json.dumps(cases))
    statuses = []
    while len(statuses) < len(cases):
        command = [sys.executable, "-m", "tests.fuzzing", file, str(len(statuses))]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, check=False)
        statuses += [int(line) for line in done.stdout.split()]
        if len(statuses) < len(cases):
            statuses.append(done.returncode)
    return statuses


def main(file, first):
    import fidelity

    answers = os.dup(1)
    for folder, words in json.loads(Path(file).read_text())[int(first):]:
        for number, name in ((1, "said.out"), (2, "said.err")):
            handle = os.open(os.path.join(folder, name), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(handle, number)
            os.close(handle)
        os.chdir(folder)
        signal.alarm(LIMIT)
        try:
            status = fidelity.main(words)
        except SystemExit as error:
            status = int(error.code or 0)
        except BaseException:
            traceback.print_exc()
            status = 70
        signal.alarm(0)
        sys.stdout.flush()
        sys.stderr.flush()
        os.write(answers, f"{status}\n".encode())


if __name__ == "__main__":
    main(*sys.argv[1:])
