"""What the terminal shows beside the log of the program."""

import subprocess
import sys

from brake_fenicsx.folder.log import logger, start_log

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
