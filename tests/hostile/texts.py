"""Texts that nobody means well: noise, depth, length, control characters, words of other languages, bombs."""

from __future__ import annotations

from tests.fuzz.forms import HUGE, WILD
from tests.fuzz.mutations import WORD, mutated_bytes, mutated_text
from tests.trials.choices import Choices

CONTROLS = [
    *(
        "\x1b[2J",
        "\x1b]0;title\x07",
        "\x1b]52;c;ZXZpbA==\x07",
        "\x9b31m",
        "\x1b[8m",
        "\x07",
        "\x08",
        "\x7f",
        "\r",
        "\x0b",
        "\x0c",
    ),
    *(
        "\u202e",
        "\u2066",
        "\u2028",
        "\u2029",
        "\u200b",
        "\ufeff",
        "\u0085",
        "\U000e0041",
        "e\u0301",
        "\ud7ff",
        "\ufffe",
    ),
]
"""What moves cursors, sets titles and clipboards, reorders or feigns lines."""
FOREIGN = [
    *(
        "*/",
        "/*",
        "//",
        '"""',
        "'''",
        "\\",
        "%",
        "{}",
        "{0}",
        "{{",
        "$(id)",
        "`id`",
        "<!--",
        "]]>",
        "#",
        ";",
        "--",
        "&&",
        "|",
    ),
    *(
        "\\input{x}",
        "\\x00",
        "\\u0000",
        "%s%n",
        "../../etc",
        "C:\\x",
        "=1+1",
        "@SUM(A1)",
        "__import__('os')",
        "eval(1)",
    ),
    *("import os", "os.system('true')", "#include <x>", "system()", "NaN", "None", "self", "class", "int", "return"),
]
"""What means something in the languages and programs that text may reach."""
BRACKETS = ["(", "[", "'", "`", ",", "(list ", "(+ 1 ", "(let ((a 1)) ", "(lambda (a) ", "#|", '"', "(rotate (0 0 1) "]
BOMBS = [
    "(defun d (n) (if (< n 1) 1 (+ (d (- n 1)) (d (- n 1))))) (defconst c (d {n}))",
    "(defun d (n) (list (d n) (d n))) (defconst c (d {n}))",
    "(defconst c (reduce * (range 1 {n}{n})))",
    "(defconst c (^ {n} (^ {n} {n})))",
    "(defconst c (length (map (lambda (x) (range 1 {n}000)) (range 1 {n}000))))",
    "(defmacro m (x) `(+ ,x ,x)) (defconst c " + "(m " * 40 + "1" + ")" * 40 + ")",
    "(defconst a0 '(x x))" + "".join(f"(defconst a{i + 1} `(,@a{i} ,@a{i}))" for i in range(40)) + "(defconst c a40)",
    "(problem p (unknowns (v (vector {n}00))) (observe (= 0 (norm v)) :sigma 1))",
    "(problem p (unknowns (v (array {n}0 {n}0))) (observe (= 0 (v 1 1)) :sigma 1))",
    "(problem p (unknowns (a)) (observe (= 0 (sum (i 1 {n}00000) (* a i))) :sigma 1))",
    "(problem p (unknowns (a :init 1)) (observe (= 0 (sum (i 1 {n}) (sum (j 1 {n}) (sin (* a i j))))) :sigma 1))",
    '(use "{n}.mbm") (use "evil.mbm")',
    "(problem p (data t (table (x) (1))) (unknowns (a)) (observe t (= x a)) (window x :length 1 :step 1e-{n}))",
    "(m (n) (part (m n))) (problem p (unknowns (a)) (observe (= [0 0 a] (vertex (m {n}) 1))))",
    "(problem p (unknowns (a)) (observe (= 1 a)) (solve :starts (random {n}00000000)))",
    "(problem p (unknowns (a)) (observe (= 1 a)) (derive (s a :over (grid t 0 1 {n}00000))))",
]
"""Small texts of large values; ``{n}`` is a number."""
NUMBERS = ["9", "25", "64", "999", "100000", "-1", "1e9", "0"]


def word(choices: Choices) -> str:
    """A hostile word."""
    match choices.below(6):
        case 0:
            return choices.one_of(CONTROLS)
        case 1 | 2:
            return choices.one_of(FOREIGN)
        case 3:
            return choices.one_of(HUGE)
        case 4:
            return choices.one_of(WILD)
        case _:
            return choices.one_of(("9", "a", "(", "é", "-", '"', "1e", ".", "𝕏", "\x00")) * 4 ** choices.below(8)


def nested(choices: Choices) -> str:
    """Brackets and quotes, thousands deep."""
    opening = choices.one_of(BRACKETS)
    closing = {"[": "]", '"': '"', "#|": "|#"}.get(opening, ")" if "(" in opening else "")
    depth = 5 ** choices.below(7)
    return opening * depth + choices.one_of(("", "a", "1", word(choices))) + closing * max(depth - choices.below(3), 0)


def hostile_text(choices: Choices, sound: str) -> bytes:
    """A file: made of nothing but noise, of hostile words, or of a sound file with some of them."""
    match choices.below(8):
        case 0:
            return bytes(choices.below(256) for _ in range(choices.below(64)))
        case 1:
            return " ".join(word(choices) for _ in range(choices.below(12))).encode("utf-8", "surrogatepass")
        case 2:
            return nested(choices).encode("utf-8", "surrogatepass")
        case 3:
            return choices.one_of(BOMBS).replace("{n}", choices.one_of(NUMBERS)).encode()
        case 4:
            return mutated_bytes(sound.encode(), choices)
        case _:
            words = [word(choices) for _ in range(3)]
            quoted = ['"' + w.replace("\\", "\\\\").replace('"', '\\"') + '"' for w in words]
            return mutated_text(sound, choices, WORD, [*words, *quoted, nested(choices)]).encode(
                "utf-8", "surrogatepass"
            )
