"""What can be wrong with a picture that is asked for: codes and constructors."""

from __future__ import annotations

from collections.abc import Iterable

from mbm.text.suggest import suggestion
from mbm.text.types import Code, Diagnostic, Place

NOTHING_TO_DRAW = Code(
    "nothing-to-draw",
    "There is nothing of the kind that was asked for: no model with values, no camera, no measurement in an image, no "
    "pose.",
    "Give `mbm view` a model by `--model`, or another kind by `--show`; `mbm solve --plot` draws what is no image.",
)
MODEL_WITHOUT_VALUES = Code(
    "model-without-values",
    "A model can be drawn only where all its arguments have values.",
    'Give them in the call: `--model "(desk 60cm 35cm 2cm 70cm)"`, or by `--set x=60cm`.',
)
TOO_MUCH_TO_DRAW = Code(
    "too-much-to-draw",
    "A picture has more parts than anybody could see, or than can be drawn in a minute.",
    "Draw a part of it: one model by `--model`, one photograph by `--photo`.",
)
UNKNOWN_PHOTO = Code(
    "unknown-photo",
    "No measurement of the problem is from the photograph that `--photo` names.",
    "The names are those of the key column: the photographs' files, or the cameras' names.",
)
BAD_PHOTOGRAPH = Code(
    "bad-photograph",
    "The file of a photograph holds no image that can be read, or one that is too large.",
    "Give a PNG file, or with Pillow installed any other kind; at most 178 megapixels.",
)


def nothing_to_draw(what: str, hint: str) -> Diagnostic:
    """``what`` says what was looked for."""
    return Diagnostic(code=NOTHING_TO_DRAW, message=f"nothing to draw: {what}", hint=hint)


def no_value(place: Place | None) -> Diagnostic:
    """An argument of a model depends on something that has no value here."""
    return Diagnostic(
        code=MODEL_WITHOUT_VALUES,
        message="this has no value where the model is drawn",
        place=place,
        hint='give numbers: `--model "(box 3 2 1)"`',
    )


def model_without_values(name: str, missing: Iterable[str], usage: str, place: Place | None) -> Diagnostic:
    """``missing`` arguments of a model have neither a default nor a value from `--set`."""
    listed = ", ".join(f"`{each}`" for each in missing)
    return Diagnostic(
        code=MODEL_WITHOUT_VALUES,
        message=f"the model `{name}` has no value of {listed}",
        place=place,
        hint=f'give values by `--set`, or the whole call by `--model "{usage}"`',
    )


def not_finite(name: str, place: Place | None) -> Diagnostic:
    """A model has points at infinity, or nearly so."""
    return Diagnostic(
        code=MODEL_WITHOUT_VALUES,
        message=f"the model `{name}` has a point without a finite place",
        place=place,
        hint="give other values of its arguments",
    )


def no_shape(form: str, place: Place | None) -> Diagnostic:
    """What `--model` says is something else."""
    return Diagnostic(
        code=NOTHING_TO_DRAW, message=f"`{form}` is no model with its arguments", place=place, hint="as `(box 3 2 1)`"
    )


def projected_shape(place: Place | None) -> Diagnostic:
    """A model that is projected has no place in space."""
    return Diagnostic(
        code=NOTHING_TO_DRAW,
        message="this model holds a projection, and only models of space are drawn",
        place=place,
        hint="draw the model that is projected",
    )


def too_much_to_draw(most: str) -> Diagnostic:
    """``most`` says what is allowed."""
    return Diagnostic(code=TOO_MUCH_TO_DRAW, message=f"the picture has more than {most}", hint="draw a part of it")


def unknown_photo(name: str, known: Iterable[str]) -> Diagnostic:
    """No image is called ``name``."""
    names = tuple(each for each in known if each)
    listed = "one of " + ", ".join(f"`{each}`" for each in names[:8])
    hint = suggestion(name, names, listed if names else "the problem has one image, without a name")
    return Diagnostic(code=UNKNOWN_PHOTO, message=f"no measurement is from the photograph `{name}`", hint=hint)


def bad_photograph(path: str, what: str) -> Diagnostic:
    """``what`` is wrong with the file."""
    return Diagnostic(
        code=BAD_PHOTOGRAPH, message=f"the photograph `{path}` {what}", hint="leave `--image` out for a blank image"
    )


def no_such_solve(number: int, count: int) -> Diagnostic:
    """``number`` counts solves from 1."""
    solves = "one solve" if count == 1 else f"{count:,} solves"
    return Diagnostic(
        code=NOTHING_TO_DRAW, message=f"nothing to draw: there is no solve {number}", hint=f"the problem has {solves}"
    )


def which_photo(known: Iterable[str]) -> Diagnostic:
    """One file cannot lie beneath several images."""
    names = ", ".join(f"`{each}`" for each in tuple(known)[:8])
    return Diagnostic(
        code=UNKNOWN_PHOTO,
        message="`--image` is one photograph, and there are measurements of several",
        hint=f"name one by `--photo`: {names}; or give a folder of photographs",
    )
