// An error anywhere in the page is written where the scene would be. Imported before all else.

for (const kind of ["error", "unhandledrejection"])
  window.addEventListener(kind, (event) => {
    const { reason, error } = /** @type {{reason?: unknown, error?: unknown}} */ (event);
    const cause = reason ?? error;
    if (!cause) return; // a browser's remark
    const why = cause instanceof Error ? cause.message : String(cause);
    document.documentElement.dataset.failed = why;
    const wait = document.getElementById("wait");
    if (wait) wait.textContent = `this browser cannot show the run: ${why}`;
  });
