"""The commands budget, countermeasures and compare."""

from typing import Any

from brake_fenicsx.commands import ALLOW, CACHE, SCENE, SET, argument, command, folder_of


@command(
    SCENE, SET, ALLOW, folder_of("budget"), CACHE,
    argument("--minutes", type=float, metavar="T",
             help="run only the refinements that fit in this time"),
)  # fmt: skip
def budget(options: Any, comm: Any) -> str:
    """Run a scene and its refinements: how much each changes the probability of squeal."""
    from .budget import run_budget

    given = options.scene, comm, options.directory, options.set, options.cache, options.minutes
    return f"open {run_budget(*given)}"


@command(
    SCENE, SET, ALLOW, folder_of("countermeasures"), CACHE,
    argument("--together", nargs=2, metavar="KEY", default=(), help="try two of the scene's"
             " countermeasures together, on a grid"),
    argument("--points", type=int, default=6, help="values of each of these; %(default)s"),
)  # fmt: skip
def countermeasures(options: Any, comm: Any) -> str | None:
    """Find the smallest change of each of the scene's countermeasures that stops the squeal.

    The results folder holds countermeasures.html and .csv, the run of the scene (before/), and one
    run for each countermeasure that is enough (after-1/, ...), compared with it. The same command
    resumes an interrupted search. docs/countermeasures.md says what is searched and how.
    """
    given = options.scene, comm, options.directory, options.set, options.cache
    if options.together:
        from .together import find_together

        page = find_together(*given, options.together, options.points)
    else:
        from .countermeasures import find_countermeasures

        page = find_countermeasures(*given)
    if comm.rank > 0 or page is None:
        return None
    return f"open {page}"


@command(
    argument("first", metavar="A", help="results folder of a run"),
    argument("second", metavar="B", help="results folder of another run"),
    argument("-o", dest="directory", metavar="DIR", default=".",
             help="folder of the comparison, . if not given"),
    alone=True,
)  # fmt: skip
def compare(options: Any, comm: Any) -> str:
    """Compare two runs: families, change of probability; or two surfaces and their laws."""
    from .comparison import comparison_text, write_comparison

    page = write_comparison(options.first, options.second, options.directory)
    return f"{comparison_text(options.first, options.second)}\nopen {page}"
