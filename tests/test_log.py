"""What the terminal shows beside the log of the program."""

import io
import os
import pty
import re
import subprocess
import sys
import termios
from contextlib import redirect_stderr, suppress

from brake_fenicsx.folder.log import Progress, logger, start_log

CODE = """
import logging
from brake_fenicsx.folder.log import logger, start_log

start_log({rank})
# As distutils does when the first form is compiled.
root = logging.getLogger()
root.setLevel(logging.INFO)
logging.info("x86_64-linux-gnu-gcc")
logging.warning("of a library")
logger.info("stage ...")
"""


def shown(rank):
    code = CODE.format(rank=rank)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return (done.stdout + done.stderr).splitlines()


def test_lines_of_the_compiler_are_not_shown_and_warnings_are():
    """28 of them stood in the log of the first run on a new machine."""
    assert shown(0) == ["warning: of a library", "stage ..."]
    assert shown(1) == ["warning: of a library"]


def test_words_of_libraries_are_short_lines():
    """A reader that guesses formats logs 1.7 MB of an .opd file that was cut: 160 characters."""
    code = CODE.format(rank=0).replace('"of a library"', '1000 * "0\\n"')
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    line, _ = done.stderr.splitlines()
    assert line.startswith("warning: 0 0 0") and line.endswith("...") and len(line) == 160


def test_warnings_on_the_terminal_say_so(capsys):
    start_log(0)
    logger.warning("half.txt: implausible")
    logger.info("stage")
    assert capsys.readouterr().err == "warning: half.txt: implausible\nstage\n"


def test_a_log_outlives_the_stderr_that_a_command_was_given(capsys):
    """Who calls a command from Python may redirect stderr, and close it before the next call."""
    with redirect_stderr(io.StringIO()) as given:
        start_log(0)
    given.close()
    Progress("samples", 1).advance()
    assert capsys.readouterr().err.startswith("samples: 1 of 1, in ")


def test_a_terminal_has_a_bar_below_the_lines():
    """Lines that come meanwhile stand above it; at the end a line takes its place."""
    code = """
import time
from brake_fenicsx.folder.log import Progress, logger, start_log

start_log(0)
progress = Progress("samples", 3)
for k in range(3):
    time.sleep(0.2)
    logger.info("line %d", k)
    progress.advance()
"""
    said = pty_output([sys.executable, "-c", code])
    assert re.search(r"samples: 2 of 3, .* to go \|█+ *\|", said)
    lines = [line.rpartition("\r")[2].strip() for line in said.split("\n") if line.strip()]
    assert lines[:-1] == ["line 0", "line 1", "line 2"]
    assert lines[-1].startswith("samples: 3 of 3, in ")


def pty_output(words):
    """What a program writes to a terminal of its own."""
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    done = subprocess.Popen(words, stdout=theirs, stderr=theirs, stdin=theirs)
    os.close(theirs)
    said = b""
    with suppress(OSError):  # the end of a terminal
        while part := os.read(ours, 4096):
            said += part
    os.close(ours)
    assert done.wait() == 0, said
    return said.decode().replace("\r\n", "\n")
