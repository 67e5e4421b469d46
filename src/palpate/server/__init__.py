"""The loopback server that shows the organ in a web page."""
