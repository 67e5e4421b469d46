"""The demos: from X-ray counts to an organ, on data that ships with the package."""
