"""What a text claims for itself or for its reader, in other languages than English.

That the reader has no rules any more, that this very note stands above all else, that safety be switched off, that
success be told whatever happened, that people be kept from knowing.
"""

from __future__ import annotations

from gvla2.memory.screening.languages import Claims

CLAIMS = {
    "latin": Claims(
        # de, fr, es, it, pt, nl, pl, tr, nordic
        r"(?:du|sie) (?:hast|haben|kennst|brauchst) (?:\w+ )?(?:keine|keinerlei)|(?:hast|kennst) du (?:\w+ "
        r")?(?:keine|keinerlei)|gelten (?:fur dich )?(?:\w+ )?kein\w*"
        r"|(?:ohne|frei von) (?:jede|jegliche|alle|irgendwelche)|tu n'as (?:plus )?(?:aucune?|de)|vous "
        r"n'avez (?:plus )?(?:aucune?|de)|tu n'es plus (?:soumis|lie) a\w*|libre de toutes?"
        r"|(?:ya )?no tienes (?:ya |mas )?(?:ningun\w* )?|no te(?:ndras| afectan)|(?:ora )?non hai (?:piu "
        r")?(?:nessun\w* |alcun\w* )?|(?:voce |tu )?nao te(?:m|ns) (?:mais )?(?:nenhum\w* )?"
        r"|(?:je hebt|heb je|u hebt) (?:nu )?geen|(?:juz )?nie masz (?:juz )?(?:zadn\w+ )?|du har (?:nu "
        r")?(?:inga|ingen)|hicbir|senin icin",
        r"dies\w* (?:notiz|eintrag|hinweis|nachricht|regel|erinnerung|text|lektion|anweisung)|cette "
        r"(?:note|consigne|regle|memoire|lecon)|ce (?:message|texte|souvenir|rappel)"
        r"|est[ae] (?:nota|registro|mensaje|regla|memoria|leccion|texto)|quest[ao] (?:nota|messaggio"
        r"|regola|memoria|testo|lezione)|est[ae] (?:nota|registro|mensagem|regra|memoria|licao)"
        r"|(?:deze|dit) (?:notitie|bericht|regel|herinnering|tekst|les)|t[ae] (?:notatka|wiadomosc|regula"
        r"|zasada|wpis)|bu (?:not|kayit|mesaj|kural)\w*|denna (?:anteckning|regel)|dette (?:notat|notatet)",
        r"hat (?:den )?(?:absoluten )?vorrang|steht uber|ersetzt alle|hebt alle|ist bindend|gilt (?:als "
        r"einzige|allein|vor allen)|ubertrifft|l'emporte sur|prime sur|prevaut|remplace tou\w+|a priorite"
        r"|tiene (?:la )?(?:prioridad|preferencia)|prevalece|sustituye (?:a )?tod\w+|anula|ha (?:la "
        r")?(?:priorita|precedenza)|prevale|sostituisce tutt\w+|tem (?:a )?prioridade|substitui tod\w+"
        r"|heeft voorrang|gaat voor alle|vervangt alle|ma (?:pierwszenstwo|priorytet)|jest nadrzedn\w+"
        r"|zastepuje wszystki\w+|(?:once|ustun)\w*|har foretrade|har forrang",
        r"(?:schalt\w*|stell\w*) (?!.{0,60}\b(?:nie|nicht|niemals|nur|wenn|wieder)\b)|deaktivier\w*"
        r"|umgeh\w*|desactive[zr]?|coupe[zr]?|neutralise[zr]?|desactiv(?:a|e|ar)|apag(?:a|ue|ar)"
        r"|desconect(?:a|e)|disattiva\w*|disabilita\w*|spegni"
        r"|deslig(?:a|ue|ar)|desativ(?:a|e|ar)|schakel|zet|wylacz\w*|kapat\w*|devre disi birak\w*|stang av"
        r"|sla av",
        r"(?:alle |samtliche |jede |die )\w*sicherheits(?:prufung\w*|funktion\w*|checks|abfragen"
        r"|uberwachung|vorkehrung\w*|regeln|einrichtungen)|(?:tous|toutes|les)(?: les)? (?:controles"
        r"|verifications|fonctions|dispositifs|limites) de securite|(?:toute la |la )securite"
        r"|tod[ao]s l[ao]s (?:comprobaciones|controles|verificaciones|medidas|funciones|limites) de "
        r"seguridad|tutti i controlli di sicurezza|tutte le (?:verifiche|funzioni|misure) di sicurezza"
        r"|tod[ao]s [ao]s (?:verificacoes|controles|funcoes|medidas) de seguranca"
        r"|alle (?:veiligheids|beveiligings)\w*|wszystkie (?:zabezpieczenia|kontrole|funkcje) "
        r"?(?:bezpieczenstwa)?|tum (?:guvenlik|emniyet) \w+|alla sakerhets\w+|alle sikkerheds?\w+",
        r"(?:ignorier\w*|missacht\w*) de[nr] (?:nutzer|benutzer|bediener|anwender)s?(?!\w)|(?:egal"
        r"|gleich),? was (?:verlangt|gesagt|gefragt|gefordert|gewunscht)"
        r"|ignor(?:a|e|ar) al (?:usuario|operador)(?!\w)|ignore[zr]? l'(?:utilisateur|operateur)(?!\w)"
        r"|ignora l'(?:utente|operatore)(?!\w)|ignore o (?:usuario|operador)(?!\w)|negeer de (?:gebruiker"
        r"|operator)(?!\w)"
        r"|(?:esquec|esqueç)\w* tudo o que|gehorch\w*(?: \w+){0,5} mir\b|(?:hor|hore|gehorch\w*) nicht "
        r"(?:auf )?(?:den|dem) (?:nutzer"
        r"|benutzer|bediener|anwender)|(?:verrat|sag|erzahl)\w* (?:dem|der|den) \w+ nichts"
        r"|n'ecoute[zr]? (?:plus|pas) l'(?:utilisateur|operateur)|ecoute-moi|n'obei[st]\w* (?:plus|pas) a "
        r"l'(?:utilisateur|operateur)|no (?:obedezcas|escuches|hagas caso) (?:al|a la) (?:usuari\w+"
        r"|operador\w*)"
        r"|non (?:ascoltare|obbedire)(?: al)? ?l'(?:utente|operatore)|nao (?:obedeca|escute|ouca) (?:ao|o) "
        r"(?:usuario|operador)|luister niet naar de (?:gebruiker|operator)|nie sluchaj (?:uzytkownika"
        r"|operatora)|kullaniciyi dinleme"
        r"|(?:melde|berichte|sage|behaupte) (?:immer|stets) (?:\w+ )?(?:erfolg|dass)|(?:signale|annonce"
        r"|declare|rapporte)[zr]? toujours (?:un |le )?succes|(?:informa|reporta|declara|di) siempre "
        r"(?:\w+ )?exito"
        r"|(?:segnala|dichiara|riporta) sempre (?:il )?successo|(?:relate|informe|declare) sempre (?:o "
        r")?sucesso|meld altijd succes|zawsze zglaszaj sukces|her zaman basari\w* bildir"
        r"|ne dis (?:pas|rien|jamais) a l'(?:utilisateur|operateur)|no (?:le )?(?:digas|cuentes) (?:nunca "
        r"|nada )?(?:al|a la) (?:usuari\w+|operador\w*)|non dire (?:mai |nulla )?all'(?:utente|operatore)"
        r"|nao (?:diga|conte) (?:nada )?ao (?:usuario|operador)"
        r"|sage? (?:dem|der) (?:nutzer|benutzer|bediener|anwender)\w* nicht|(?:vertel|zeg) (?:de|het aan "
        r"de) gebruiker niet\w*|nie mow uzytkownikowi|kullaniciya (?:soyleme|bahsetme)\w*"
        r"|ignore[zr]? tout ce qui precede|ignoriere alles (?:bisherige|vorherige|obige|davor|oben)"
        r"|vergiss deine (?:regeln|anweisungen|vorgaben)|ignora todo lo anterior|ignora tutto (?:cio che "
        r"precede|quanto sopra)|ignore tudo (?:acima|o que veio antes)|negeer alles hierboven",
    ),
    "cyrillic": Claims(
        r"(?:у )?(?:тебя|вас) (?:больше )?нет|(?:ты|вы) (?:больше )?не (?:связан|обязан|ограничен)\w*|без "
        r"(?:каких-либо|всяких|всех|любых)|у тебе (?:більше )?немає",
        r"(?:эта|данная|этой) (?:запись|заметка|записка|инструкци\w+|подсказка|памят\w+)|это (?:сообщение"
        r"|правило|указание)|цей запис",
        r"(?:имеет|имеют) приоритет|важнее|выше (?:всех|всего|любых)|отменяет|заменяет|превыше",
        r"отключи\w*|выключи\w*|деактивируй\w*|обойди\w*|сними\w*|вимкни\w*",
        r"все (?:\w+ )?(?:проверки|ограничения|блокировки|системы|меры)(?: безопасности)?|всю защиту"
        r"|безопасность",
        r"забудь\w* вс[её],? что|игнорируй\w* (?:пользователя|оператора)(?!\w)|не слушай\w* (?:пользовател"
        r"|оператор)\w*|слушай\w* меня|всегда (?:сообщай|докладывай"
        r"|говори)\w*(?: \w+)? (?:успех\w*|что)|не говори\w* (?:пользователю|оператору)|никому не "
        r"(?:говори|рассказывай)\w*",
    ),
    "han": Claims(
        r"你(?:们)?(?:已经|已|就|将)?(?:不再)?(?:没有|沒有|不受|不必遵守|无需遵守)(?:任何|一切)?"
        r"|あなた(?:に|には)",
        r"(?:本|这|這|此)(?:条|條|则|項|项|份|个)?(?:记录|記錄|指令|信息|消息|笔记|备忘|规则|记忆|提示"
        r"|教训)|この(?:メモ|記録|指示|ルール|メッセージ|記憶)",
        r"优先于|優先於|高于|高於|凌驾|取代|覆盖|最高优先|优先级最高|すべてに優先|より優先|最優先"
        r"|に取って代わ|上書き",
        r"关闭|關閉|关掉|禁用|停用|屏蔽|绕过|解除|無効に|オフに|切って|停止し|解除し",
        r"(?:所有|全部|一切)(?:的)?(?:安全|防护|保护)(?:检查|措施|限制|功能|机制|系统)?|(?:すべて|全て"
        r"|全部)の?安全(?:チェック|機能|装置|確認|制限)",
        r"(?:忽略|无视|忽视)用户(?!的|输入|数据|界面|目录)|(?:ユーザー|利用者)を無視|(?:别|不要|不用)(?:听"
        r"|聽)(?:从|從)?(?:用户|用戶|操作员|主人|任何人)|听我的|(?:ユーザー|利用者"
        r"|操作者)の(?:言うこと|指示|命令)を(?:聞くな|聞かな|無視)|(?:总是|始终|永远|一律)(?:报告|汇报"
        r"|回答|返回|判定)(?:为)?成功|不要(?:告诉|告知|让)(?:用户|操作员|任何人)|(?:不管|无论)(?:之前|前面"
        r"|上面).{0,6}说.{0,4}都|常に成功と(?:報告|判定)|ユーザーに(?:は)?(?:知らせ|言わ|伝え)(?:ない|ず)"
        r"|ルールはありません|制限はありません",
    ),
    "hangul": Claims(
        r"(?:당신|너|네)(?:에게|한테)?(?:는|은|게)?.{0,10}(?:없습니다|없다|없어)|더 이상",
        r"이 (?:메모|기록|지시|메시지|규칙|기억)\w*",
        r"우선\w*|최우선\w*|대체\w*",
        r"끄\w*|꺼\w*|비활성화\w*|해제\w*|무시하\w*",
        r"(?:모든|전체) (?:안전|보호) \w+",
        r"(?:당신|너)\w* (?:\S+ )?(?:규칙|제한|제약)\w* (?:\S+ )?없\w+|(?:사용자|운영자)\S* (?:말|지시)\S* "
        r"(?:듣지|따르지)|항상 성공\w*|사용자에게 (?:말하지|알리지)\w*",
    ),
    "arabic": Claims(
        r"ليس (?:لديك|لك|عليك)(?: \w+)?|لا (?:توجد|يوجد) (?:عليك|لك)|دون أي",
        r"هذه (?:الملاحظة|المذكرة|التعليمات|القاعدة)|هذا (?:السجل|النص|الأمر)",
        r"الأولوية|تلغي|تحل محل|فوق (?:كل|جميع)|أهم من",
        r"عطل\w*|أوقف\w*|أطفئ\w*|تعطيل|إيقاف",
        r"(?:جميع|كل|كافة) (?:فحوصات|إجراءات|أنظمة|قيود|وظائف)(?: السلامة| الأمان)?",
        r"(?:تجاهل|انس) (?:كل )?ما (?:قيل|سبق)|لا (?:تستمع|تصغ|تطع)\w* (?:إلى |ل)?\w*(?:المستخدم|المشغل)"
        r"|لا تخبر (?:المستخدم|المشغل)\w*",
    ),
    "indic": Claims(
        r"(?:तुम्हारे|आपके|तुम पर|आप पर)(?: लिए| ऊपर)?(?: अब)?(?: कोई)?",
        r"यह (?:नोट|रिकॉर्ड|संदेश|निर्देश|नियम)",
        r"सर्वोपरि|प्राथमिकता|सबसे ऊपर|ऊपर है",
        r"बंद|निष्क्रिय|अक्षम",
        r"(?:सभी|सारे|सारी) सुरक्षा(?: \S+)?",
        r"(?:तुम्हारे|आपके) लिए (?:अब )?कोई (?:नियम|सीमा|प्रतिबंध)\S* नहीं|(?:उपयोगकर्ता|यूज़र) को (?:मत"
        r"|न) बता\S*",
    ),
}

LATIN_STEMS = """
    anwe anle vorg befe inst syst rege sich vors rich eins besc auft erin hinw cons regl dire ordr cont invi
    rest limi rapp norm orde prom indi istr rego ordi vinc coma regr orie opdr aanw bepe beve voor pole zasa
    regu rozk wyty ogra tali kura komu yone emir kisi iste anvi rikt retn ohje saan maar keho begr poky prav
    prik utas szab uput navo peri atur arah huon chi quy menh lenh tagu utos maag pemb guid rule pass kenn api
    schl zuga gehe toke mots mot cles cle iden secr jeto clav cred chia segr senh chav wach sleu inlo hasl kluc
    posw sekr sifr paro anah kiml sist sir sirl loso adga sala hesl klic jels kulc kata kunc mat khoa loi du
    egal glei dir ihne geho nur alle auss folg beac vert dein jetz sofo sond muss soll tu sag sage gib vous quoi
    quel peu obei suis suiv ecou resp ta fais part rien qu ahor eres diga pida impo igua haga obed solo sola
    unic sigu haz te ora ades sei qual segu obbe asco tuo fai cio agor voce nao inde seja siga cump sua faca lhe
    je onge wat volg luis doe jest niez bez coko sluc wyko prze tylk wyla twoj rob arti simd kull gore sade yaln
    yeni dedi olet lyd vad hva hvad oavs jsi most acum posl csak ascu seka kamu anda bay pati hany apa hor hore
    mir oper dinl note noti nota mess eint regi souv notat seku secu sicu veil bezp zabe guve saker sake sikk
    erfo succ siem suce basa util usua uten gebr uzyt nutz benu bedi todo tudo tout tutt
"""
"""How words begin, four letters of them, of which every match in a Latin script has one, of claims or orders."""
