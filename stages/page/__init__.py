"""The HTML page that stages share: sections, tables, plots, equations, colours."""
