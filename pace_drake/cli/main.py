"""The ``pace`` command: groups the verbs and turns user errors into one line and exit code 2."""

import sys
import warnings

import click

from pace_drake import __version__
from pace_drake.errors import InputError
from pace_drake.processes import use_one_thread


class _Verbs(click.Group):
    """Imports a verb only when it is called: ``pace --help`` need not wait for Drake or torch."""

    _modules = (
        *("run", "train", "export", "sweep", "thresholds", "timeline", "view", "diagram"),
        *("scenarios", "demos", "tune", "evaluate", "chart"),
        *("bridge", "replay", "driver", "hand", "record", "operator"),
    )

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self._modules)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in self._modules:
            return None
        import importlib

        return importlib.import_module(f"pace_drake.cli.{name}").command


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="pace")
def pace() -> None:
    """Proactive robot assistance: simulate, train and evaluate when a robot should go and help."""


def _warn(message: Warning | str, category: type[Warning], *_: object) -> None:
    """A warning as everything else that goes wrong: one line, without a place in the source."""
    if issubclass(category, UserWarning):
        print(f"pace: warning: {message}", file=sys.stderr)


def main(arguments: list[str] | None = None) -> None:
    """Entry point. Exits with 0, with 2 for input that cannot be used, with 130 after Ctrl-C."""
    warnings.showwarning = _warn  # type: ignore[assignment]
    use_one_thread()
    try:
        code = pace.main(args=arguments, prog_name="pace", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message())
        sys.exit(0)
    except (click.ClickException, InputError) as error:
        message = error.format_message() if isinstance(error, click.ClickException) else str(error)
        print(f"pace: {' '.join(message.split())}", file=sys.stderr)
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt) as error:
        # click turns Ctrl-C into Abort and keeps the message, if a verb has one.
        detail = str(error.__cause__ or error)
        print(f"pace: interrupted{'; ' if detail else ''}{detail}", file=sys.stderr)
        sys.exit(130)
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
