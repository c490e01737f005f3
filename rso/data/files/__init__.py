"""Measured files: text, workbooks, headers and tables as instruments write them, read into cells with units."""
