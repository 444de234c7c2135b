"""Results to what a person reads: tables, figures, fields for ParaView, one HTML page.

A run directory in, its ``figures``, ``tables`` and ``report.html`` out: ``figures.make_figures``,
``overview.write_tables``, ``html.write_report``. The run itself writes its tables with
``tables.write_rows``, its fields with ``fields.write_fields`` and ``contact_fields.write_facets``,
its pictures with ``render.render_mode``. Whatever a run did not compute is left out.
"""
