"""Results to what a person reads: figures, fields for ParaView, one HTML page.

A run directory in, its ``figures`` and ``report.html`` out: ``figures.make_figures``,
``html.write_report``. The run itself writes its fields with ``fields`` and its pictures with
``render``. Whatever a run did not compute is left out.
"""
