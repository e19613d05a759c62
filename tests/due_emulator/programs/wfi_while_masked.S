// WFI wakes on a masked interrupt, which is then taken.
// seconds: 0.0105
// handlers: 15 count
// slots: 0 10, 1 10
  movs r2, #0
  keep r2, 0
  keep r2, 1
  systick 3999, 7  // each millisecond
3: cpsid i
  wfi
  load r3, 0x20070000
  cpsie i
  nop
  load r4, 0x20070000
  subs r4, r3
  load r5, 0x20070004
  add r5, r4
  keep r5, 1
  b 3b
  count_ticks
