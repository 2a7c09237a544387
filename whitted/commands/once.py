"""A command whose options are given once, unless they are made to be repeated."""

from typing import Any

from typer.core import TyperCommand


class OnceCommand(TyperCommand):
    """A command that refuses an option that is given twice, where the last one would count."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not ctx.resilient_parsing:
            _, _, given = self.make_parser(ctx).parse_args(args=list(args))
            for option in dict.fromkeys(given):
                if not getattr(option, "multiple", True) and given.count(option) > 1:
                    name = max(option.opts, key=len)
                    raise ValueError(f"{name}: given more than once; give it once")
        return super().parse_args(ctx, args)
