"""Analysis: from the record to a report, by measures, statistics, figures and topics."""
