"""What `pip install` does beyond copying files: it compiles the kernels where that is possible."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Kernels(BuildHookInterface):
    """Adds the compiled kernels to the wheel, or says why there are none."""

    PLUGIN_NAME = "custom"

    def initialize(self, version, build_data):
        """Compile, before the files are collected."""
        if self.target_name != "wheel":
            return
        builder = self._builder()
        try:
            library = builder.build()
        except builder.CannotBuild as reason:
            self.app.display_warning(f"jaxcontact: no compiled kernels, pure JAX is used: {reason}")
            return
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
        build_data["force_include"][str(library)] = f"jaxcontact/native/{library.name}"

    def _builder(self):
        """The module `jaxcontact.native.build`, without the packages that its package needs."""
        path = Path(self.root) / "jaxcontact" / "native" / "build.py"
        spec = spec_from_file_location("kernels_build", path)
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
