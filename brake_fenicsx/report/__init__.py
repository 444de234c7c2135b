"""Results to what a person reads: tables, figures, fields for ParaView, one HTML page."""
