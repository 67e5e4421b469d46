"""What opens a page with an organ or images: a widget in a notebook, a browser elsewhere."""
