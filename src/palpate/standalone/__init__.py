"""An organ in one file: the page, the engine as WebAssembly, and the tissue."""
