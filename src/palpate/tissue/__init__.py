"""From a mesh to tissue: finite elements as truth, and models that answer a push in real time."""
