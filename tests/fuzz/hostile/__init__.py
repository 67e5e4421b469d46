"""Files that lie, by format: each case writes one into a folder and returns its name; all of them must be refused."""
