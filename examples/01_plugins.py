"""What can be chosen, and with which options: the catalog that `gvla2 plugins` prints, from Python.

python examples/01_plugins.py
"""

from gvla2.plugins.kinds import KINDS
from gvla2.plugins.manager import structured
from gvla2.plugins.registry import load_plugins

registry = load_plugins()

for kind in KINDS:
    for name, component in registry.components(kind).items():
        options = [key for key in structured(component) if key != "name"]
        print(f"{kind}={name}: {component.summary}")
        if options:
            print(f"    {', '.join(f'{kind}.{option}' for option in options)}")

for problem in registry.problems:
    print(f"broken: {problem.plugin} {problem.hook}: {problem.message}")
