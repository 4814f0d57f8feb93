"""Write a trained agent in a form that needs neither this package nor PyTorch.

    wt-gym export agents/trained/load_reduction --to onnx --out exported

onnx: the policy from measured channels in SI units to the action, scaling and clipping inside, with a card of what it
is made for. Needs the extra "export" (onnx, onnxruntime).
"""

from __future__ import annotations

import argparse
import json

from wt_gym.commands.program import UNSAFE, OneLineParser, user_errors

FORMS = ("onnx",)


def parse_arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = OneLineParser("export", description=__doc__, epilog=UNSAFE)
    parser.add_argument("agent", help="path of a trained model: its folder, or its file")
    parser.add_argument("--to", choices=FORMS, default="onnx", help="form (default: %(default)s)")
    parser.add_argument("--out", required=True, help="folder for the files")
    parser.add_argument("--json", action="store_true", help="print what was written as JSON at the end")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> None:
    """Export."""
    arguments = parse_arguments(words)
    with user_errors():
        import onnx  # noqa: F401 - refused before anything is made
        import onnxruntime  # noqa: F401

        from wt_gym.agents.export.policy import export_onnx

        made = export_onnx(arguments.agent, arguments.out)
    for file in made["files"]:
        print(file)
    print(f"actions equal those of the policy within {made['largest_difference']:.1e}")
    if arguments.json:
        print(json.dumps(made))
