// WFE sleeps unless an interrupt came since the last one, which sets the event register.
// seconds: 0.05
// handlers: 15 count
// slots: 1 10, 2 10, 3 11
  movs r2, #0
  keep r2, 0
  systick 3999, 7  // each millisecond
  ldr r2, =20000
1: subs r2, #1
  bne 1b
  load r3, 0x20070000
  keep r3, 1
  wfe
  load r3, 0x20070000
  keep r3, 2
  wfe
  load r3, 0x20070000
  keep r3, 3
  wait_forever
  count_ticks
