"""`python -m benchmarks NAME`: run one benchmark; without a name, list them."""

import importlib
import pkgutil
import sys

import benchmarks


def main(arguments: list[str]) -> int:
    names = sorted(m.name for m in pkgutil.iter_modules(benchmarks.__path__) if not m.name.startswith("_"))
    if not arguments or arguments[0] not in names:
        print("usage: python -m benchmarks NAME [--json FILE]")
        for name in names:
            module = importlib.import_module(f"benchmarks.{name}")
            print(f"  {name:12} {(module.__doc__ or '').splitlines()[0]}")
        return 0 if not arguments else 2
    importlib.import_module(f"benchmarks.{arguments[0]}").main(arguments[1:])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
