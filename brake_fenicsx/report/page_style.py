"""Style sheet of the HTML page: system fonts only, black on white, also on a dark screen.

On a narrow screen figures and tables keep the width at which they can be read and scroll alone.
"""

CSS = """\
:root { color-scheme: light; }
body { font: 15px/1.5 "DejaVu Sans", "Segoe UI", Helvetica, Arial, sans-serif; color: #1a1a1a;
  background: #fff; margin: 0 auto; max-width: 1000px; padding: 0 24px 48px; }
h1 { font-size: 1.6em; margin: 1em 0 0.5em; }
h2 { font-size: 1.25em; margin: 2em 0 0.6em; border-bottom: 2px solid #0072B2; }
h3 { font-size: 1.05em; margin: 1.4em 0 0.4em; }
nav { display: flex; flex-wrap: wrap; gap: 0.3em 1.4em; padding: 0.6em 0;
  border-top: 1px solid #ccc; border-bottom: 1px solid #ccc; }
nav a { color: #00517f; }
figure { margin: 1.2em 0; break-inside: avoid; }
figure img { display: block; width: 100%; max-width: 960px; height: auto; }
figcaption { font-size: 0.9em; color: #444; margin-top: 0.3em; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.87em; margin: 1em 0; break-inside: auto; }
th, td { padding: 0.25em 0.8em 0.25em 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid #ddd; overflow-wrap: break-word; }
td:first-child { white-space: nowrap; }
th { border-bottom: 1.5px solid #555; overflow-wrap: normal; }
td.share, td.short { white-space: nowrap; }
thead { display: table-header-group; }
td.number { font-variant-numeric: tabular-nums; white-space: nowrap; }
tr { break-inside: avoid; }
pre { font: 0.82em/1.45 "DejaVu Sans Mono", Consolas, monospace; background: #f5f5f5;
  padding: 0.8em 1em; white-space: pre-wrap; overflow-wrap: anywhere; }
@media screen and (max-width: 720px) {
  body { padding: 0 14px 32px; }
  h1 { overflow-wrap: anywhere; }
  figure img { width: 660px; max-width: none; }
  figure.shape img { width: 560px; }
  table { width: max-content; max-width: 820px; }
}
@page { size: A4; margin: 16mm 14mm; }
@media print {
  body { font-size: 10pt; max-width: none; padding: 0; }
  .wide { overflow: visible; }
  table { font-size: 8pt; }
  th, td { padding-right: 0.6em; }
  nav { display: none; }
  figure img { width: auto; max-width: 100%; max-height: 122mm; }
  figure.shape img { max-height: 112mm; }
  h2, h3 { break-after: avoid; }
  pre { background: #fff; border: 1px solid #bbb; }
}
"""
