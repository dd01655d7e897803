"""Why a filter cannot go on. By itself, for mypyc compiles no class of exceptions."""


class DivergenceError(ArithmeticError):
    """The state of a filter means nothing any more."""
