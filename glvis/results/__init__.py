"""What came out, as numbers and files: tables, the result folder, reasons, exports of poses."""
