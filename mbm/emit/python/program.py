"""The end of a generated Python module: tables from files, and the program that solves them."""

from __future__ import annotations

from inspect import getsource

from mbm.emit.c.header import STATUSES, UNSETTLED
from mbm.text.shown import one_line

SHOWING = f'''{getsource(one_line)}

def field(text: str) -> str:
    """A field of a table in CSV: a spreadsheet, too, takes it for a text."""
    shown = ("'" if text.startswith(("=", "+", "-", "@", "\\t", "\\r")) else "") + one_line(text)
    return '"' + shown.replace('"', '""') + '"' if "," in shown or '"' in shown else shown
'''
"""What is printed: mbm's own rule for texts that reach a terminal."""

PROGRAM = '''def read_tables(paths: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The tables from CSV files in the order of `COLUMNS`; numbers are turned into SI."""
    found: dict[str, dict[str, Any]] = {}
    for path, (table, columns) in zip(paths, COLUMNS.items(), strict=True):
        try:
            with open(path, encoding="utf-8-sig", newline="") as file:
                rows = [row for row in csv.reader(file) if row]
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise DataError(f"{path}: cannot be read: {error}") from None
        names = rows[0] if rows else []
        found[table] = {}
        for column, (is_text, source, factor, zero) in columns.items():
            if source not in names:
                raise DataError(f"{path}, row 1: there is no column `{source}`")
            place = names.index(source)
            values: list[Any] = []
            for number, row in enumerate(rows[1:], start=2):
                if len(row) != len(names):
                    raise DataError(f"{path}, row {number}: has another number of fields than the names in row 1")
                try:
                    values.append(row[place] if is_text else finite(row[place]) * factor + zero)
                except ValueError:
                    shown = row[place][:60]
                    raise DataError(f"{path}, row {number}, column `{source}`: `{shown}` is no number") from None
            found[table][column] = np.array(values, dtype=str if is_text else float)
    return found


def finite(cell: str) -> float:
    """A decimal number; raises ValueError for anything else."""
    value = float(cell)
    if "_" in cell or not math.isfinite(value):
        raise ValueError(cell)
    return value


def lines_of(result: Mapping[str, Any]) -> Iterator[str]:
    """``name,value,sigma,unit`` for each number, in the unit that the problem shows."""
    for u, name in enumerate(NAMES):
        unit, factor, zero, turned = SHOWN[u]
        values, sigmas = result["estimates"][name]["value"], result["estimates"][name]["sigma"]
        for m, member in enumerate(values):
            for c, value in enumerate(member):
                family, keys = FAMILIES[u], result["estimates"][name]["keys"]
                label = name + ("" if family is None else f"[{key_text(keys[m], family[1], family[2])}]")
                label += f"[{c + 1}]" if len(member) > 1 else ""
                sigma = "" if turned else spread_text(sigmas[m][c] / factor)
                yield f"{field(label)},{(value - zero) / factor:.17g},{sigma},{field(unit)}"
    for (name, table, size, *_), (unit, factor, zero) in zip(DERIVED, DERIVED_SHOWN, strict=True):
        found = result["derived"][name]
        for r, (values, sigmas) in enumerate(zip(found["value"], found["sigma"], strict=True)):
            for c in range(size):
                label = name + (f"[{r + 1}]" if table is not None else "") + (f"[{c + 1}]" if size > 1 else "")
                shown = f"{(values[c] - zero) / factor:.17g},{spread_text(sigmas[c] / factor)}"
                yield f"{field(label)},{shown},{field(unit)}"


def spread_text(sigma: float) -> str:
    """A standard deviation; nothing where there is none."""
    return "" if math.isnan(sigma) else f"{sigma:.17g}"


def key_text(value: Any, table: str, column: str | None) -> str:
    """A key as the files have it."""
    is_text, _, factor, zero = COLUMNS[table][column] if column is not None else (True, "", 1.0, 0.0)
    return str(value) if is_text else f"{(value - zero) / factor:.15g}"


def key_field(value: Any, table: str, column: str) -> str:
    """A key in CSV: numbers as they are, texts as fields."""
    text = key_text(value, table, column)
    return field(text) if COLUMNS[table][column][0] else text


def main(paths: Sequence[str]) -> int:
    """Solve the tables of files; 0 solved, 1 an answer that should not be trusted, 2 wrong data."""
    if len(paths) != len(COLUMNS):
        usage = " ".join(f"{name.upper()}.csv" for name in COLUMNS)
        print(one_line(f"usage: {sys.argv[0]} {usage}"), file=sys.stderr)
        return 2
    worst = 0
    owner = next(name for name, columns in COLUMNS.items() if set(KEYS) <= set(columns)) if KEYS else ""
    try:
        tables = read_tables(paths)
        print(",".join([*map(field, KEYS), "name", "value", "sigma", "unit"]))
        for key, chosen in data_sets(tables):
            worst = max(worst, show([key_field(value, owner, column) for column, value in key.items()], chosen))
    except DataError as error:
        print(one_line(f"error: {error}"), file=sys.stderr)
        return 2
    return worst


def show(keys: Sequence[str], tables: Tables) -> int:
    """Solve one data set and print what was found; the exit status of `main` for it."""
    try:
        result = solve(tables)
        if result["status"] == "not-finite":
            raise DataError("@NOT_FINITE@")
    except DataError as error:
        print(one_line(f"error: {error}"), file=sys.stderr)
        return 2
    for line in lines_of(result):
        print(",".join([*keys, line]))
    print(
        f"{result['status']}: chi2 {result['cost']:.9g}, {result['freedom']} degrees of freedom, "
        f"sigma0 {result['sigma0']:.6g}, {result['iterations']} iterations",
        file=sys.stderr,
    )
    if not result["settled"]:
        print("@UNSETTLED@", file=sys.stderr)
    if result["agreement"] is not None:
        agreed = result["agreement"]
        doubt = ", but as many may agree elsewhere" if agreed["ambiguous"] else ""
        print(f"{agreed['inliers']} of {agreed['units']} measurements agree{doubt}", file=sys.stderr)
    return 0 if result["status"] == "converged" else 1


if __name__ == "__main__":
    sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = main(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:
        # whoever read the lines has seen enough: nothing more is written, also not at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 1
    sys.exit(status)
'''.replace("@NOT_FINITE@", STATUSES["NOT_FINITE"]).replace("@UNSETTLED@", UNSETTLED)
"""The program itself; it says of a start what the one in C says."""
