"""Analyse answers to the page of blind comparisons: `python -m pipelines.preferences KEY ANSWERS...`."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from pentimento.contracts.errors import ContractError
from pentimento.copainting.evaluation.preferences import preferences, read_answers
from pipelines._io import stage_main


def main(arguments: argparse.Namespace) -> None:
    """Print, for each rival, how often ours was preferred, with the exact binomial test."""
    try:
        key = json.loads(arguments.key.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ContractError(
            f"{arguments.key} is no key ({error}); it lies beside the page, preference_key.json."
        ) from error
    found = preferences(read_answers(arguments.answers, key), key)
    print(json.dumps({rival: asdict(preference) for rival, preference in found.items()}, indent=2))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="preferences", description=__doc__)
    parser.add_argument("key", type=Path, help="preference_key.json, which the stage evaluate_copainting wrote")
    parser.add_argument("answers", nargs="+", type=Path, help="files that people saved from preference.html")
    stage_main(main, parser)
