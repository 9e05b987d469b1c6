"""What can be wrong with the calls of an estimator: codes and constructors."""

from __future__ import annotations

from mbm.text.suggest import suggestion
from mbm.text.types import Code, Diagnostic

NO_SUCH_INPUT = Code(
    "no-such-input",
    "An estimator is to take a column that no equation uses, of which several tables have one, or twice.",
    "Name the column as `table.column`; leave the names out to replace all measured columns.",
)
DECIDING_INPUT = Code(
    "deciding-input",
    "An estimator is to take a column that decides more than the values of equations: which rows count, their noise, a "
    "member of a family, what the equation is.",
    "Solve with `compiled.solve(data=…)`, which sees such changes, or keep the column as it was when it was compiled.",
)
NOT_A_STREAM = Code(
    "not-a-stream",
    "An estimator solves one data set at a time from one start, and a stream takes the steps of one sequence as they "
    "come; the problem asks for several solves or starts, or for what needs all steps at once.",
    "Use `solve`, or a problem without `for-each`, `window` and `:starts`; for a stream, one with states, whose rows "
    "mention their own step alone and whose smoother has no bounds.",
)
WRONG_INPUT = Code(
    "wrong-input",
    "An array given to an estimator has another shape than its table asks for, or than the other arrays of the table.",
    "Give one array for each column, with as many numbers as the table has rows; `estimator.many` takes one such line "
    "for each data set. A table may have any number of rows if the inputs are all that equations use of it.",
)

WRONG_STEP = Code(
    "wrong-step",
    "The rows given to a stream are not those of the next step: of a table without steps, of several steps, or of one "
    "that is over; or their columns are others than those of the compiled data.",
    "Give the rows of one step at a time, in the order of the steps.",
)
STREAM_STOPPED = Code(
    "stream-stopped",
    "A stream cannot go on: at a step something was not finite, or a transition led nowhere.",
    "Begin a new stream with `compiled.stream()`; a start nearer to the truth or smaller deviations may help.",
)
WRONG_ARGUMENT = Code(
    "wrong-argument",
    "An argument of a call from Python is of another kind than the call takes.",
    "A problem is a text, or the name of a file; tables, constants and true values are given by name, in a dict; "
    "`workers` is a whole number from 1, or None; `trials` is `auto` or a whole number from 2; `x` has one "
    "number for each name in `result.covariance.names`.",
)


def no_such_input(name: str, known: tuple[str, ...], *, several: bool) -> Diagnostic:
    """A column that is none, or more than one."""
    if several:
        return Diagnostic(
            code=NO_SUCH_INPUT,
            message=f"`{name}` may mean several columns",
            place=None,
            hint=f"write {_listed(known, ' or ')}",
        )
    candidates = (*known, *(each.split(".", 1)[1] for each in known))
    hint = suggestion(name, candidates, f"the equations use {_listed(known, ', ')}")
    return Diagnostic(code=NO_SUCH_INPUT, message=f"no equation uses a column `{name}`", place=None, hint=hint)


def deciding_input(name: str, what: str) -> Diagnostic:
    """A column that cannot be replaced without compiling again."""
    return Diagnostic(
        code=DECIDING_INPUT,
        message=f"`{name}` decides {what} and cannot be an input of an estimator",
        place=None,
        hint="`compiled.solve(data=…)` takes any columns",
    )


def not_a_stream(what: str) -> Diagnostic:
    """A problem that asks for more than one descent."""
    return Diagnostic(
        code=NOT_A_STREAM,
        message=f"a problem with {what} has no estimator",
        place=None,
        hint="`solve` makes all its solves in one batch",
    )


def no_stream(what: str, hint: str) -> Diagnostic:
    """A problem whose steps cannot be taken as they come."""
    return Diagnostic(code=NOT_A_STREAM, message=f"a problem {what} has no stream", place=None, hint=hint)


def gives_steps_once() -> Diagnostic:
    """A stream that gives each step when it comes, and not again."""
    hint = "say `(solve :method smoother)` or `batch`, which give each step all rows so far"
    return Diagnostic(code=NOT_A_STREAM, message="this stream gives each step once", place=None, hint=hint)


def not_of_a_step(name: str, column: str, known: tuple[str, ...]) -> Diagnostic:
    """A table whose rows belong to no step."""
    return Diagnostic(
        code=WRONG_STEP,
        message=f"`{name}` is no table with steps: it has no column `{column}`",
        place=None,
        hint=suggestion(name, known, f"a step has rows of {_listed(known, ', ')}"),
    )


def not_one_step(column: str, keys: list[float]) -> Diagnostic:
    """Rows of no step, or of several."""
    found = "no step is named" if not keys else f"rows of the steps {_listed(tuple(f'{k:g}' for k in keys), ', ')}"
    return Diagnostic(
        code=WRONG_STEP,
        message=f"{found}: all rows have one and the same `{column}`",
        place=None,
        hint=f"state `{column}` in the rows, or say `at=`",
    )


def step_is_over(column: str, key: float, before: float) -> Diagnostic:
    """A step that does not follow on the last one."""
    return Diagnostic(
        code=WRONG_STEP,
        message=f"the step {key:g} does not follow on {before:g}",
        place=None,
        hint=f"steps come in the order of `{column}`, and all rows of a step together",
    )


def lacks_columns(name: str, columns: tuple[str, ...]) -> Diagnostic:
    """Rows that lack columns which those had that the problem was compiled with."""
    return Diagnostic(
        code=WRONG_STEP,
        message=f"the rows of `{name}` lack {_listed(columns, ', ')}",
        place=None,
        hint="rows of a step have the columns that the problem was compiled with",
    )


def other_cells(name: str, column: str, *, texts: bool) -> Diagnostic:
    """Numbers where the problem was compiled with texts, or the other way round."""
    wanted, found = ("texts", "numbers") if texts else ("numbers", "texts")
    return Diagnostic(
        code=WRONG_STEP,
        message=f"`{column}` of `{name}` holds {found}, and held {wanted} when the problem was compiled",
        place=None,
    )


def stream_stopped(column: str, key: float) -> Diagnostic:
    """A stream that cannot go on."""
    return Diagnostic(
        code=STREAM_STOPPED,
        message=f"the stream has ended at `{column}` = {key:g}, where something was not finite",
        place=None,
        hint=STREAM_STOPPED.mend,
    )


def stream_finished() -> Diagnostic:
    """A stream that the caller has ended."""
    return Diagnostic(
        code=STREAM_STOPPED,
        message="the stream has ended: its last steps were given by `finish`",
        place=None,
        hint="begin a new stream for further steps",
    )


def wrong_count(expected: tuple[str, ...], count: int) -> Diagnostic:
    """Too many or too few arrays."""
    return Diagnostic(
        code=WRONG_INPUT,
        message=f"arrays given: {count}; inputs: {len(expected)}, {_listed(expected, ', ')}",
        place=None,
        hint="they are taken in the order of `estimator.inputs`",
    )


def no_numbers(name: str) -> Diagnostic:
    """An array of something else, or lines of different lengths."""
    return Diagnostic(
        code=WRONG_INPUT,
        message=f"what is given for `{name}` is no array of numbers",
        place=None,
        hint="NumPy must be able to make an array of float64 of it; complex numbers are none",
    )


def repeated_input(name: str) -> Diagnostic:
    """A column that is to be taken twice."""
    return Diagnostic(code=NO_SUCH_INPUT, message=f"`{name}` is named twice", place=None, hint="name each input once")


def wrong_shape(name: str, shape: tuple[int, ...], rows: int | None, sets: int | None, hint: str | None) -> Diagnostic:
    """An array that has not ``rows`` numbers (None: any number), or such a line for each of ``sets`` data sets (None:
    for one call). ``hint``: what to do about a table that keeps its rows.
    """
    found = f"{' × '.join(map(str, shape))} numbers" if shape else "one number"
    wanted = f"{'' if sets is None else f'{sets} × '}{'n' if rows is None else rows}"
    if sets is None and len(shape) == 2:
        hint = "`estimator.many` takes many data sets"
    return Diagnostic(
        code=WRONG_INPUT,
        message=f"`{name}` has {found}; {wanted} are wanted, one for each row of its table",
        place=None,
        hint=hint or "inputs of one table have as many numbers, for as many data sets",
    )


def held_by(table: str, column: str | None, what: str) -> str:
    """What to do about a table whose rows decide more than values."""
    reason = "its rows are" if column is None else f"`{table}.{column}` decides"
    return f"`{table}` keeps its rows: {reason} {what}; `compiled.solve(data=…)` takes tables of any length"


def lacking_inputs(table: str, columns: tuple[str, ...]) -> str:
    """What to do about a table of which equations use columns that are no inputs."""
    names = _listed(tuple(f"{table}.{column}" for column in columns), ", ")
    return f"for any number of rows name what else equations use of `{table}` among the inputs: {names}"


def compiled_empty(table: str) -> str:
    """What to do about a table that had no rows when the estimator was made."""
    return f"compile with rows in `{table}` for an estimator that takes any number of them"


def wrong_rows(most: int, sets: int) -> Diagnostic:
    """Numbers of rows that do not go with lines of ``most`` numbers for so many data sets."""
    return Diagnostic(
        code=WRONG_INPUT,
        message=f"`rows` is not one whole number from 0 to {most} for each of {sets} data sets",
        place=None,
        hint="it says how many numbers of each line count; every array has a line for each data set",
    )


def not_by_name(argument: str, what: str) -> Diagnostic:
    """``what`` was given where values by name are wanted."""
    return Diagnostic(
        code=WRONG_ARGUMENT,
        message=f"`{argument}` is {what}",
        place=None,
        hint=f"give a dict: `{argument}={{name: …}}`",
    )


def no_yes_or_no(argument: str, given: object) -> Diagnostic:
    """What is neither True nor False."""
    return Diagnostic(
        code=WRONG_ARGUMENT,
        message=f"`{argument}` is {given!r}; True or False is wanted",
        place=None,
        hint="leave it out for False",
    )


def no_number_of_threads(given: object) -> Diagnostic:
    """A number of threads that is none."""
    return Diagnostic(
        code=WRONG_ARGUMENT,
        message=f"`workers` is {given!r}; a whole number from 1 is wanted",
        place=None,
        hint="leave it out for one thread a processor",
    )


def no_number_of_trials(given: object) -> Diagnostic:
    """A number of trials that is none."""
    return Diagnostic(
        code=WRONG_ARGUMENT,
        message=f"`trials` is {given!r}; `auto` or a whole number from 2 is wanted",
        place=None,
        hint="10,000 trials give 95 % intervals to about two hundredths of the standard deviation",
    )


def no_place_of_a_step(given: object) -> Diagnostic:
    """A place of a step that is none."""
    return Diagnostic(
        code=WRONG_ARGUMENT,
        message=f"`at` is {given!r}; a finite number is wanted",
        place=None,
        hint="it is where the step is, in SI: the value of the steps' column",
    )


def no_text(given: object) -> Diagnostic:
    """A problem that is no text."""
    return Diagnostic(
        code=WRONG_ARGUMENT,
        message=f"a problem is a text (`str`), not a value of type `{type(given).__name__}`",
        place=None,
        hint="`mbm.load` takes the name of a file",
    )


def no_path(given: object) -> Diagnostic:
    """A file that has no name."""
    return Diagnostic(
        code=WRONG_ARGUMENT,
        message=f"`path` is a value of type `{type(given).__name__}`; the name of a file (`str` or `Path`) is wanted",
        place=None,
        hint="`mbm.loads` takes the text of a problem",
    )


def no_seed(given: object) -> Diagnostic:
    """A seed that is none."""
    return Diagnostic(
        code=WRONG_ARGUMENT,
        message=f"`seed` is {given!r}; a whole number from 0 is wanted",
        place=None,
        hint="leave it out for that of the problem",
    )


def no_coordinates(what: str, count: int) -> Diagnostic:
    """Tangent coordinates that are not ``count`` numbers."""
    return Diagnostic(
        code=WRONG_ARGUMENT,
        message=f"`x` {what}; the shape ({count},) is wanted",
        place=None,
        hint="it is a step from the start, one number for each name in `result.covariance.names`",
    )


def _listed(names: tuple[str, ...], between: str) -> str:
    return between.join(f"`{name}`" for name in names)
