"""The live page: what it remembers (`history`), says (`facts`) and draws (`figures`, `page`)."""
