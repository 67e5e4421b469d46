"""What the library says of its keywords, in the words of the command line: --closed-at-border for closed_at_border=True."""

import re

import typer
from typer.core import TyperCommand

from palpate.errors import PalpateError

VALUE = r"(?:'(?P<single>[^']*)'|\"(?P<double>[^\"]*)\"|(?P<plain>[\w.+-]+))"
OTHERWISE = {  # what the library calls the option of another name
    "count": "views",
    "height": "distance",
    "length": "extent",
    "radius": "extent",
    "inclusions": "inclusion",
}
_options: dict[str, str] = {}  # of the command that runs: parameter to option


class OptionCommand(TyperCommand):
    """A command whose errors and notes name its options."""

    def invoke(self, ctx: typer.Context) -> object:  # type: ignore[override]
        """Runs the command."""
        _options.clear()
        for parameter in self.params:
            for option in parameter.opts:
                if option.startswith("--"):
                    _options[str(parameter.name)] = option
        _options.update({k: _options[v] for k, v in OTHERWISE.items() if k not in _options and v in _options})
        try:
            return super().invoke(ctx)
        except PalpateError as refusal:
            refusal.args = (option_names(str(refusal)), *refusal.args[1:])
            raise


def option_names(text: str) -> str:
    """The text with options of the command that runs for keywords: "keyword=value", and "keyword: ..." at the start."""

    def assigned(found: re.Match[str]) -> str:
        option = _options.get(found["name"])
        if option is None:
            return found[0]
        value = next(v for v in (found["single"], found["double"], found["plain"]) if v is not None)
        return option if value == "True" else f"{option} {value}"

    text = re.sub(rf"(?<![-\w])(?P<name>[a-z_]+)={VALUE}", assigned, text)
    first = re.match(r"[a-z_]+(, [a-z_]+)*(?=: )", text)
    if first and all(name in _options for name in first[0].split(", ")):
        text = ", ".join(_options[name] for name in first[0].split(", ")) + text[first.end() :]
    return re.sub(r"(?<![-\w])[a-z]+(_[a-z]+)+\b(?![.(])", lambda found: _options.get(found[0], found[0]), text)
