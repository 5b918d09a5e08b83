"""What a report is made of: results looked up, tables, figures, pictures, and the page around them.

`report` puts them together. `results` answers questions to the metrics and matches; `grids` turn
answers into tables for page and Markdown, `csv_text` into CSV; `figures` are SVG, `pictures` JPEG;
`paper` holds the published figures; `templates/report.html.j2` is the page.

Several runs side by side: `run_folder` reads a finished run, `comparison` puts runs together,
`table_1` and `azimuths` turn them into tables; `operating_points` tunes thresholds for `table_2`.
"""
