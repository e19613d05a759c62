// The theme wraps the copy button of each block of code in a <nav> without a name: landmarks that nobody can tell apart.
new MutationObserver(() => {
  for (const nav of document.querySelectorAll("nav.md-code__nav:not([role])")) nav.setAttribute("role", "none")
}).observe(document.documentElement, {childList: true, subtree: true})
